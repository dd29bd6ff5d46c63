//! The best one-to-one assignment between two sets.
//!
//! Shortest augmenting paths with dual prices (Jonker and Volgenant 1987, for rectangles as Crouse has it, IEEE
//! Transactions on Aerospace and Electronic Systems 52(4), 2016). Rows are added one by one; each takes the cheapest
//! path to a free column. Time grows with rows² × columns at worst, memory is linear beside the scores.

/// The pairs `(row, column)` with the largest sum of scores, by row; min(rows, columns) of them.
///
/// `scores` is rows × columns, row after row. Where several assignments are best, it is the one that scipy's
/// `linear_sum_assignment` gives (free columns before taken ones, then in order of search), so that counts over
/// pairs equals what peers count.
///
/// # Panics
/// `scores` has not rows × columns numbers, or one is not finite.
pub fn best(scores: &[f64], rows: usize, columns: usize) -> Vec<(usize, usize)> {
    assert!(rows.checked_mul(columns) == Some(scores.len()), "{rows} x {columns} scores are promised");
    assert!(scores.iter().all(|s| s.is_finite()), "scores are promised to be finite");
    if rows <= columns {
        return columns_of(rows, columns, &|i, j| -scores[i * columns + j]).into_iter().enumerate().collect();
    }
    let rows_of = columns_of(columns, rows, &|i, j| -scores[j * columns + i]);
    let mut pairs: Vec<_> = rows_of.into_iter().enumerate().map(|(column, row)| (row, column)).collect();
    pairs.sort_unstable();
    pairs
}

/// The column of each of n rows, n ≤ m, of the least total cost.
fn columns_of(n: usize, m: usize, cost: &dyn Fn(usize, usize) -> f64) -> Vec<usize> {
    let (mut row_price, mut column_price) = (vec![0.0; n], vec![0.0; m]);
    let (mut column_of, mut row_of) = (vec![usize::MAX; n], vec![None; m]);
    let (mut length, mut before) = (vec![f64::INFINITY; m], vec![0; m]);
    // Columns not yet reached are open[..left]; those behind are reached, the last of them first.
    let mut open: Vec<usize> = (0..m).collect();
    for start in 0..n {
        length.fill(f64::INFINITY);
        open.iter_mut().enumerate().for_each(|(k, column)| *column = m - 1 - k);
        let (mut left, mut row, mut reached) = (m, start, 0.0);
        let end = loop {
            let (mut nearest, mut at) = (f64::INFINITY, 0);
            for (k, &column) in open[..left].iter().enumerate() {
                let through = reached + cost(row, column) - row_price[row] - column_price[column];
                if through < length[column] {
                    (length[column], before[column]) = (through, row);
                }
                if length[column] < nearest || (length[column] == nearest && row_of[column].is_none()) {
                    (nearest, at) = (length[column], k);
                }
            }
            let column = open[at];
            reached = nearest;
            left -= 1;
            open.swap(at, left);
            match row_of[column] {
                Some(taken_by) => row = taken_by,
                None => break column,
            }
        };
        row_price[start] += reached;
        for &column in &open[left..] {
            let short = reached - length[column];
            column_price[column] -= short;
            if let Some(row) = row_of[column] {
                let row: usize = row;
                row_price[row] += short;
            }
        }
        let mut column = end;
        loop {
            let row = before[column];
            row_of[column] = Some(row);
            std::mem::swap(&mut column_of[row], &mut column);
            if row == start {
                break;
            }
        }
    }
    column_of
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_base::rng::{Purpose, Streams};
    use rand::RngExt;

    /// The largest sum over all ways to give each row a column of its own, or none of the rest.
    fn by_trying(scores: &[f64], columns: usize, row: usize, taken: &mut Vec<bool>, skip: usize) -> f64 {
        if row * columns == scores.len() {
            return 0.0;
        }
        let mut largest = f64::NEG_INFINITY;
        if skip > 0 {
            largest = by_trying(scores, columns, row + 1, taken, skip - 1);
        }
        for j in 0..columns {
            if !std::mem::replace(&mut taken[j], true) {
                largest = largest.max(scores[row * columns + j] + by_trying(scores, columns, row + 1, taken, skip));
                taken[j] = false;
            }
        }
        largest
    }

    #[test]
    fn the_sum_is_that_of_trying_everything() {
        // 2000 tables of up to 6 x 6, seed 1, half of them of small integers (ties); the sum is unique: never fails.
        for trial in 0..2000 {
            let mut rng = Streams::new(1, 0).at(trial, Purpose::Scene).rng(0);
            let (rows, columns) = (rng.random_range(0..=6), rng.random_range(1..=6));
            let mut draw = |_| match trial % 2 {
                0 => rng.random_range(-3..4) as f64,
                _ => rng.random_range(-1.0..1.0),
            };
            let scores: Vec<f64> = (0..rows * columns).map(&mut draw).collect();
            let pairs = best(&scores, rows, columns);
            assert!(pairs.len() == rows.min(columns) && pairs.is_sorted(), "{pairs:?}");
            let mut seen: Vec<_> = pairs.iter().map(|&(_, j)| j).collect();
            seen.sort_unstable();
            seen.dedup();
            assert_eq!(seen.len(), pairs.len(), "a column twice");
            let sum: f64 = pairs.iter().map(|&(i, j)| scores[i * columns + j]).sum();
            let skip = rows.saturating_sub(columns);
            let wanted = by_trying(&scores, columns, 0, &mut vec![false; columns], skip);
            assert!((sum - wanted).abs() < 1e-12, "{sum} {wanted} {scores:?}");
        }
    }

    #[test]
    fn ties_and_large_tables() {
        assert_eq!(best(&[], 0, 0), []);
        assert_eq!(best(&[], 3, 0), []);
        // Any assignment is best: what scipy 1.17 answers.
        assert_eq!(best(&[0.0; 6], 2, 3), [(0, 0), (1, 1)]);
        assert_eq!(best(&[0.0; 6], 3, 2), [(0, 0), (1, 1)]);
        // 300 x 200, the best of row 199 - j is column j and nothing else scores.
        let mut scores = vec![0.0; 300 * 200];
        (0..200).for_each(|j| scores[(199 - j) * 200 + j] = 1.0 + j as f64);
        let pairs = best(&scores, 300, 200);
        assert!(pairs.iter().all(|&(i, j)| i + j == 199) && pairs.len() == 200);
    }
}
