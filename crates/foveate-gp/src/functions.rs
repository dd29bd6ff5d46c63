//! Functions that optimisers are compared on (Dixon & Szegő 1978); the smallest value is sought.

use std::f64::consts::PI;

pub(crate) fn branin([x, y]: &[f64; 2]) -> f64 {
    (y - 5.1 / (4.0 * PI * PI) * x * x + 5.0 / PI * x - 6.0).powi(2) + 10.0 * (1.0 - 0.125 / PI) * x.cos() + 10.0
}

const HEIGHT: [f64; 4] = [1.0, 1.2, 3.0, 3.2];

fn hartmann<const D: usize>(x: &[f64; D], rate: &[[f64; D]; 4], at: &[[f64; D]; 4]) -> f64 {
    let hill = |k: usize| -> f64 {
        let d: f64 = (0..D).map(|i| rate[k][i] * (x[i] - 1e-4 * at[k][i]).powi(2)).sum();
        HEIGHT[k] * (-d).exp()
    };
    -(0..4).map(hill).sum::<f64>()
}

pub(crate) fn hartmann3(x: &[f64; 3]) -> f64 {
    const RATE: [[f64; 3]; 4] = [[3.0, 10.0, 30.0], [0.1, 10.0, 35.0], [3.0, 10.0, 30.0], [0.1, 10.0, 35.0]];
    const AT: [[f64; 3]; 4] =
        [[3689.0, 1170.0, 2673.0], [4699.0, 4387.0, 7470.0], [1091.0, 8732.0, 5547.0], [381.5, 5743.0, 8828.0]];
    hartmann(x, &RATE, &AT)
}

pub(crate) fn hartmann6(x: &[f64; 6]) -> f64 {
    const RATE: [[f64; 6]; 4] = [
        [10.0, 3.0, 17.0, 3.5, 1.7, 8.0],
        [0.05, 10.0, 17.0, 0.1, 8.0, 14.0],
        [3.0, 3.5, 1.7, 10.0, 17.0, 8.0],
        [17.0, 8.0, 0.05, 10.0, 0.1, 14.0],
    ];
    const AT: [[f64; 6]; 4] = [
        [1312.0, 1696.0, 5569.0, 124.0, 8283.0, 5886.0],
        [2329.0, 4135.0, 8307.0, 3736.0, 1004.0, 9991.0],
        [2348.0, 1451.0, 3522.0, 2883.0, 3047.0, 6650.0],
        [4047.0, 8828.0, 8732.0, 5743.0, 1091.0, 381.0],
    ];
    hartmann(x, &RATE, &AT)
}
