//! Symmetric positive definite systems of a few unknowns.

/// A symmetric matrix, row by row.
pub(super) type Matrix = Vec<Vec<f64>>;

/// The inverse of a matrix, and the natural logarithm of its determinant.
pub(super) struct Inverse {
    pub matrix: Matrix,
    pub log_det: f64,
}

/// Inverts a symmetric positive definite matrix by its Cholesky factor, with rows and columns scaled to a unit diagonal. Returns `None` if
/// it is not positive definite in floating point.
pub(super) fn invert(a: &[Vec<f64>]) -> Option<Inverse> {
    const PIVOT: f64 = 1e-13;
    let n = a.len();
    let scale: Vec<f64> = (0..n).map(|i| a[i][i].sqrt()).collect();
    if scale.iter().any(|s| !(*s > 0.0 && s.is_finite())) {
        return None;
    }
    // L Lᵀ of the scaled matrix, and W = L⁻¹.
    let (mut l, mut w) = (vec![vec![0.0; n]; n], vec![vec![0.0; n]; n]);
    for i in 0..n {
        for j in 0..=i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            let rest = a[i][j] / (scale[i] * scale[j]) - sum;
            if i == j {
                if rest.is_nan() || rest <= PIVOT {
                    return None;
                }
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
        let entry = |j: usize| {
            let unit = f64::from(u8::from(i == j));
            (unit - (j..i).map(|k| l[i][k] * w[k][j]).sum::<f64>()) / l[i][i]
        };
        w[i] = (0..n).map(|j| if j > i { 0.0 } else { entry(j) }).collect();
    }
    let entry = |i: usize, j: usize| (i.max(j)..n).map(|k| w[k][i] * w[k][j]).sum::<f64>() / (scale[i] * scale[j]);
    let matrix = (0..n).map(|i| (0..n).map(|j| entry(i, j)).collect()).collect();
    let log_det = (0..n).map(|i| 2.0 * (l[i][i] * scale[i]).ln()).sum();
    Some(Inverse { matrix, log_det })
}

/// Returns the product of a matrix and a vector.
pub(super) fn times(a: &[Vec<f64>], x: &[f64]) -> Vec<f64> {
    a.iter().map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_inverse_of_a_matrix_of_unequal_scales() {
        let a = vec![vec![4e6, 2e2, 1e3], vec![2e2, 0.05, 0.1], vec![1e3, 0.1, 3.0]];
        let inverse = invert(&a).expect("positive definite");
        for i in 0..3 {
            let row = times(&a, &inverse.matrix.iter().map(|row| row[i]).collect::<Vec<_>>());
            for (j, value) in row.iter().enumerate() {
                let scale = (a[j][j] / a[i][i]).sqrt();
                assert!((value - f64::from(u8::from(i == j))).abs() < 1e-12 * scale.max(1.0), "{i} {j} {value}");
            }
        }
        let minor = |i: usize, j: usize| {
            let pick = |i: usize| (0..3).filter(move |k| *k != i);
            let m: Vec<f64> = pick(i).flat_map(|r| pick(j).map(move |c| (r, c))).map(|(r, c)| a[r][c]).collect();
            m[0] * m[3] - m[1] * m[2]
        };
        let determinant = a[0][0] * minor(0, 0) - a[0][1] * minor(0, 1) + a[0][2] * minor(0, 2);
        assert!((inverse.log_det - determinant.ln()).abs() < 1e-12);
        assert!(invert(&[vec![1.0, 1.0], vec![1.0, 1.0]]).is_none());
    }
}
