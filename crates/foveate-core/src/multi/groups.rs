//! The best one-to-one assignment of few fits among many: the targets and detections that share fits form groups, which are solved one by
//! one.

use crate::assignment;

/// The score, above 0, of a detection for a target, by their indices.
#[derive(Clone, Copy, Debug)]
pub(super) struct Fit {
    pub i: usize,
    pub j: usize,
    pub score: f64,
}

/// Largest product of targets and detections that is solved at once; above it, groups without shared fits are solved separately.
const AT_ONCE: usize = 1 << 16;
/// Largest product of targets and detections in a group that is solved exactly, in cubic time; above it, the best fits are assigned first.
const LARGEST: usize = 1 << 22;

/// Returns the detection of each target, if it has one, with the largest sum of scores.
pub(super) fn best(fits: &[Fit], rows: usize, columns: usize) -> Vec<Option<usize>> {
    let mut given = vec![None; rows];
    if rows.saturating_mul(columns) <= AT_ONCE {
        let all = (&(0..rows).collect::<Vec<_>>()[..], &(0..columns).collect::<Vec<_>>()[..]);
        exact(fits, all, &mut given);
        return given;
    }
    let mut groups = Groups((0..rows + columns).collect());
    fits.iter().for_each(|fit| groups.join(fit.i, rows + fit.j));
    let mut sorted: Vec<(usize, Fit)> = fits.iter().map(|fit| (groups.of(fit.i), *fit)).collect();
    sorted.sort_by_key(|(group, _)| *group);
    for group in sorted.chunk_by(|a, b| a.0 == b.0) {
        let fits: Vec<Fit> = group.iter().map(|(_, fit)| *fit).collect();
        let members = |of: fn(&Fit) -> usize| {
            let mut members: Vec<usize> = fits.iter().map(of).collect();
            members.sort_unstable();
            members.dedup();
            members
        };
        let (rows, columns) = (members(|fit| fit.i), members(|fit| fit.j));
        match rows.len() * columns.len() <= LARGEST {
            true => exact(&fits, (&rows, &columns), &mut given),
            false => greedy(fits, &mut given),
        }
    }
    given
}

/// Solves the assignment of these rows and columns; `fits` are all fits among them.
fn exact(fits: &[Fit], (rows, columns): (&[usize], &[usize]), given: &mut [Option<usize>]) {
    let mut scores = vec![0.0; rows.len() * columns.len()];
    let at = |all: &[usize], one: usize| all.binary_search(&one).expect("a member of its group");
    for fit in fits {
        scores[at(rows, fit.i) * columns.len() + at(columns, fit.j)] = fit.score;
    }
    for (i, j) in assignment::best(&scores, rows.len(), columns.len()) {
        if scores[i * columns.len() + j] > 0.0 {
            given[rows[i]] = Some(columns[j]);
        }
    }
}

fn greedy(mut fits: Vec<Fit>, given: &mut [Option<usize>]) {
    fits.sort_by(|a, b| b.score.total_cmp(&a.score).then((a.i, a.j).cmp(&(b.i, b.j))));
    let mut taken = std::collections::HashSet::new();
    for Fit { i, j, .. } in fits {
        if given[i].is_none() && taken.insert(j) {
            given[i] = Some(j);
        }
    }
}

/// Disjoint sets, each with one representative member.
struct Groups(Vec<usize>);

impl Groups {
    fn of(&mut self, mut member: usize) -> usize {
        while self.0[member] != member {
            self.0[member] = self.0[self.0[member]];
            member = self.0[member];
        }
        member
    }
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::Streams;
    use rand::RngExt;

    /// 300 × 300 in groups of up to about ten, seed 1: the result is that of one solution, because the best is unique.
    #[test]
    fn groups_give_the_assignment_of_one_solution() {
        let mut rng = Streams::new(1, 0).rng(0);
        let fits: Vec<Fit> = (0..300)
            .flat_map(|i| (0..300).map(move |j| (i, j)))
            .filter(|(i, j)| i / 7 == j / 7)
            .map(|(i, j)| Fit { i, j, score: rng.random::<f64>() + 1e-3 })
            .collect();
        let mut at_once = vec![None; 300];
        let all: Vec<usize> = (0..300).collect();
        exact(&fits, (&all, &all), &mut at_once);
        assert_eq!(best(&fits, 300, 300), at_once);
        assert!(at_once.iter().all(Option::is_some));
    }

    #[test]
    fn a_group_of_many_is_assigned_best_fits_first() {
        let n = 2100;
        let fit = |k: usize| Fit { i: k / n, j: k % n, score: 1.0 / (1 + (k / n).abs_diff(k % n)) as f64 };
        let given = best(&(0..n * n).map(fit).collect::<Vec<_>>(), n, n);
        assert!(given.iter().enumerate().all(|(i, j)| *j == Some(i)));
    }
}
