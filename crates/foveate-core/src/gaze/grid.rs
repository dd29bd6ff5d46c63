//! Fixed gazes on the template, for policies with a finite set of gazes.

use crate::geometry::Gaze;
use foveate_base::Result;
use foveate_base::error::within;
use serde::{Deserialize, Serialize};

/// n × n gazes over the square from −reach to reach, column by column: with n = 3 they are the paper's G1 to
/// G9 (G1 to G3 down the left side, G5 the centre).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Grid {
    /// Gazes along a side; 1 is the centre alone.
    pub n: usize,
    /// Distance of the outer gazes from the centre, template units; 1 is the edge of the box.
    pub reach: f64,
}

impl Default for Grid {
    /// The grid of the authors' prototype: ±7 px on a digit of 28 px. The authors' figure has 0.83.
    fn default() -> Self {
        Self { n: 3, reach: 0.5 }
    }
}

impl Grid {
    /// Checks the grid.
    ///
    /// # Errors
    /// If there is no gaze, or there are more than a thousand, or the reach is not finite.
    pub fn check(&self) -> Result<()> {
        within("grid.n", self.n as f64, 1.0, 31.0)?;
        within("grid.reach", self.reach, 0.0, 10.0)
    }
    /// Returns the gazes; arm k is the k-th.
    pub fn gazes(&self) -> Vec<Gaze> {
        let n = self.n;
        let at = |i: usize| if n == 1 { 0.0 } else { self.reach * (2.0 * i as f64 / (n - 1) as f64 - 1.0) };
        (0..n * n).map(|k| Gaze { u: at(k / n), v: at(k % n), arm: Some(k) }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_by_three_is_the_papers_layout() {
        let at: Vec<_> = Grid { n: 3, reach: 0.5 }.gazes().iter().map(|g| (g.u, g.v, g.arm)).collect();
        assert_eq!(at[0], (-0.5, -0.5, Some(0)), "G1 is the upper left");
        assert_eq!(at[2], (-0.5, 0.5, Some(2)), "G3 is the lower left");
        assert_eq!(at[4], (0.0, 0.0, Some(4)), "G5 is the centre");
        assert_eq!(at[8], (0.5, 0.5, Some(8)), "G9 is the lower right");
        assert_eq!(Grid { n: 1, reach: 0.5 }.gazes(), [Gaze { arm: Some(0), ..Gaze::CENTRE }]);
    }
}
