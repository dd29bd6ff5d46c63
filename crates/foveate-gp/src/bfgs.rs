//! Minimising a smooth function of a few variables between bounds: BFGS on the free variables, along projected paths
//! (Nocedal & Wright 2006, chapters 6 and 16.7; Bertsekas 1982).

/// The most variables.
pub(super) const MOST: usize = 16;
/// Of the decrease that the slope promises, the part that must come true (Armijo).
const SUFFICIENT: f64 = 1e-4;
/// The longest step in one variable; in logarithms, a factor of 7.
const LONGEST: f64 = 2.0;
/// Shorter steps tried before giving up.
const TRIALS: usize = 12;

/// Numbers for each variable; the first `n` count.
pub(super) type Row = [f64; MOST];

/// The function to minimise.
pub(super) trait Objective {
    /// At `x`, which becomes the point at hand. Not finite: worse than everything.
    fn value(&mut self, x: &[f64]) -> f64;
    /// At the point at hand.
    fn gradient(&mut self, g: &mut [f64]);
    /// A first guess of the second derivatives at the point at hand.
    fn curvature(&mut self, b: &mut [Row]);
}

/// How it went.
#[derive(Clone, Copy, Debug)]
pub(super) struct Outcome {
    pub value: f64,
    pub iterations: usize,
    pub evaluations: usize,
    /// A further step promised less than the tolerance.
    pub converged: bool,
    /// The point at hand is the one found.
    pub at_hand: bool,
}

/// Moves `x`, within `bounds`, to a nearby minimum, never to a larger value. `value` is the value at `x`. Ends if a
/// Newton step would gain less than `tolerance`.
pub(super) fn minimise(
    objective: &mut impl Objective,
    x: &mut [f64],
    bounds: &[(f64, f64)],
    value: f64,
    tolerance: f64,
    most: usize,
) -> Outcome {
    let n = x.len();
    let mut done = Outcome { value, iterations: 0, evaluations: 0, converged: false, at_hand: true };
    let (mut g, mut b) = ([0.0; MOST], [[0.0; MOST]; MOST]);
    objective.gradient(&mut g[..n]);
    objective.curvature(&mut b[..n]);
    while done.iterations < most {
        let Some(mut step) = newton(&b, &g, x, bounds) else { break };
        let reference = -0.5 * dot(&g[..n], &step);
        if reference <= tolerance {
            done.converged = reference >= 0.0;
            break;
        }
        let longest = step[..n].iter().fold(0.0f64, |m, s| m.max(s.abs()));
        if longest > LONGEST {
            step.iter_mut().for_each(|s| *s *= LONGEST / longest);
        }
        // Backtrack.
        let (old, mut t, mut found) = (done.value, 1.0, None);
        let mut trial = [0.0; MOST];
        for _ in 0..TRIALS {
            for i in 0..n {
                trial[i] = (x[i] + t * step[i]).clamp(bounds[i].0, bounds[i].1);
            }
            let slope: f64 = (0..n).map(|i| g[i] * (trial[i] - x[i])).sum();
            let value = objective.value(&trial[..n]);
            done.evaluations += 1;
            if value <= old + SUFFICIENT * slope && slope < 0.0 {
                found = Some(value);
                break;
            }
            // The minimum of the parabola through both values and the slope.
            let bend = value - old - slope;
            let shorter = if bend.is_finite() && bend > 0.0 { -0.5 * slope / bend } else { 0.1 };
            t *= shorter.clamp(0.1, 0.5);
        }
        done.iterations += 1;
        let Some(value) = found else {
            done.at_hand = false;
            break;
        };
        done.value = value;
        let (mut moved, mut turned) = ([0.0; MOST], g);
        objective.gradient(&mut g[..n]);
        for i in 0..n {
            (moved[i], turned[i]) = (trial[i] - x[i], g[i] - turned[i]);
        }
        x.copy_from_slice(&trial[..n]);
        update(&mut b, &moved[..n], &mut turned[..n]);
    }
    done
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// −B⁻¹ g over the variables that are not at a bound; `None` if B is not positive or g not finite.
fn newton(b: &[Row; MOST], g: &Row, x: &[f64], bounds: &[(f64, f64)]) -> Option<Row> {
    let (mut free, mut count) = ([0; MOST], 0);
    for (i, (&x, &(lower, upper))) in x.iter().zip(bounds).enumerate() {
        if !(x <= lower && g[i] > 0.0 || x >= upper && g[i] < 0.0) {
            free[count] = i;
            count += 1;
        }
    }
    let free = &free[..count];
    let (mut l, mut y, mut step) = ([[0.0; MOST]; MOST], [0.0; MOST], [0.0; MOST]);
    for (i, &row) in free.iter().enumerate() {
        for (j, &column) in free[..=i].iter().enumerate() {
            let left = b[row][column] - dot(&l[i][..j], &l[j][..j]);
            l[i][j] = if i > j {
                left / l[j][j]
            } else if left > 0.0 {
                left.sqrt()
            } else {
                return None;
            };
        }
        y[i] = (-g[row] - dot(&l[i][..i], &y[..i])) / l[i][i];
    }
    for i in (0..count).rev() {
        let below: f64 = (i + 1..count).map(|k| l[k][i] * step[free[k]]).sum();
        step[free[i]] = (y[i] - below) / l[i][i];
    }
    step.iter().all(|s| s.is_finite()).then_some(step)
}

/// Damped BFGS (Powell 1978): B stays positive whatever the curvature met.
fn update(b: &mut [Row; MOST], moved: &[f64], turned: &mut [f64]) {
    let n = moved.len();
    let mut bs = [0.0; MOST];
    for i in 0..n {
        bs[i] = dot(&b[i][..n], moved);
    }
    let (sbs, sy) = (dot(&bs[..n], moved), dot(moved, turned));
    if !(sbs > 0.0 && sy.is_finite()) {
        return;
    }
    let part = if sy >= 0.2 * sbs { 1.0 } else { 0.8 * sbs / (sbs - sy) };
    for (y, bs) in turned.iter_mut().zip(&bs) {
        *y = part * *y + (1.0 - part) * bs;
    }
    let sy = dot(moved, turned);
    for i in 0..n {
        for j in 0..n {
            b[i][j] += turned[i] * turned[j] / sy - bs[i] * bs[j] / sbs;
        }
    }
}
