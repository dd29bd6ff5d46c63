//! Distortion of a lens, from a calibration file of OpenCV.

use std::path::Path;

use foveate_base::{Error, Result, files};

use super::track::Position;

/// A camera of OpenCV's model: camera matrix, radial (k) and tangential (p) distortion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// Focal lengths, pixels.
    focal: [f64; 2],
    /// Principal point, pixels; the centre of the first pixel is (0, 0).
    centre: [f64; 2],
    /// k1, k2, p1, p2, k3.
    distortion: [f64; 5],
    /// Width and height of the calibrated pictures, if the file states them.
    pub size: Option<[usize; 2]>,
}

/// Derivatives of x, then of y, by x and y.
type Jacobian = [[f64; 2]; 2];

/// Newton steps at most; a point that the model can show needs about five.
const STEPS: usize = 50;
/// The names of the camera matrix and of the coefficients.
const MATRIX: [&str; 3] = ["camera_matrix", "cameraMatrix", "Camera_Matrix"];
const COEFFICIENTS: [&str; 4] = ["distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs"];

impl Lens {
    #[cfg(test)]
    pub(super) fn simple(focal: [f64; 2], centre: [f64; 2], k1: f64) -> Self {
        Self { focal, centre, distortion: [k1, 0.0, 0.0, 0.0, 0.0], size: None }
    }

    /// Checks that it was calibrated with pictures of this width and height, if its file states them.
    ///
    /// # Errors
    /// The sizes differ.
    pub(super) fn check(&self, [width, height]: [usize; 2]) -> Result<()> {
        match self.size {
            Some([w, h]) if [w, h] != [width, height] => Err(Error::Invalid(format!(
                "--lens: it was calibrated with pictures of {w} x {h}, these are {width} x {height}; give the calibration of this size"
            ))),
            _ => Ok(()),
        }
    }

    /// Reads a file that OpenCV's `FileStorage` wrote (YAML, XML or JSON), or one of ROS (`camera_info`, YAML).
    ///
    /// # Errors
    /// The file cannot be read, has no camera matrix or no coefficients, or is of another model, such as that of a fisheye lens.
    pub fn read(path: &Path) -> Result<Self> {
        Self::parse(&files::read_text(path, files::TEXT)?).map_err(|problem| Error::malformed(path, problem))
    }

    fn parse(text: &str) -> std::result::Result<Self, String> {
        let data = |names: &[&str]| {
            let found = names.iter().find_map(|name| numbers(data_of(after(text, name)?)));
            found.ok_or_else(|| format!("it has no {}; give a calibration file of OpenCV", names[0]))
        };
        let word = |name| {
            Some(after(text, name)?.split(|c: char| !c.is_alphanumeric() && c != '_').find(|word| !word.is_empty()))
        };
        let other =
            word("distortion_model").flatten().filter(|model| !["plumb_bob", "rational_polynomial"].contains(model));
        let fisheye = word("fisheye_model").flatten().filter(|is| !["0", "false"].contains(is)).map(|_| "fisheye");
        if let Some(model) = other.or(fisheye) {
            return Err(format!("it is of the model {model}; calibrate with k1, k2, p1, p2 and k3 (plumb_bob)"));
        }
        let matrix = data(&MATRIX)?;
        let all = data(&COEFFICIENTS)?;
        let [fx, skew, cx, _, fy, cy, ..] = matrix[..] else {
            return Err(format!("its camera matrix has {} numbers; expected 9", matrix.len()));
        };
        if !(matrix.len() == 9 && fx > 0.0 && fy > 0.0 && skew == 0.0) {
            return Err("its camera matrix is not that of OpenCV: expected fx 0 cx, 0 fy cy, 0 0 1".into());
        }
        if all.len() < 4 || all.iter().skip(5).any(|k| *k != 0.0) {
            let problem = "distortion coefficients; expected k1, k2, p1, p2 and k3: calibrate without other models";
            return Err(format!("it has {} {problem}", all.len()));
        }
        let distortion = std::array::from_fn(|i| all.get(i).copied().unwrap_or(0.0));
        let side = |names: [&str; 2]| names.iter().find_map(|name| numbers(after(text, name)?)?.first().copied());
        let size = side(["image_width", "image_Width"]).zip(side(["image_height", "image_Height"]));
        let size = size.map(|(width, height)| [width as usize, height as usize]);
        Ok(Self { focal: [fx, fy], centre: [cx, cy], distortion, size })
    }

    /// Returns where the lens shows a point of the plane z = 1, in that plane, and the derivatives.
    fn distort(&self, [x, y]: [f64; 2]) -> ([f64; 2], Jacobian) {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let r = x * x + y * y;
        let radial = 1.0 + r * (k1 + r * (k2 + r * k3));
        let slope = 2.0 * (k1 + r * (2.0 * k2 + r * 3.0 * k3));
        let at = [
            x * radial + 2.0 * p1 * x * y + p2 * (r + 2.0 * x * x),
            y * radial + p1 * (r + 2.0 * y * y) + 2.0 * p2 * x * y,
        ];
        let across = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
        let jacobian = [
            [radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x, across],
            [across, radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x],
        ];
        (at, jacobian)
    }

    /// Returns where a point of the picture would be without distortion, and the derivatives by its coordinates; `None` if the model shows
    /// no point there.
    fn inverse(&self, point: (f64, f64)) -> Option<((f64, f64), Jacobian)> {
        let [fx, fy] = self.focal;
        let shown = [(point.0 - self.centre[0]) / fx, (point.1 - self.centre[1]) / fy];
        let mut at = shown;
        for _ in 0..STEPS {
            let (found, [[a, b], [c, d]]) = self.distort(at);
            let determinant = a * d - b * c;
            // Beyond the fold of a polynomial, two points have one image.
            if !(determinant > 0.0 && a > 0.0) {
                return None;
            }
            let off = [shown[0] - found[0], shown[1] - found[1]];
            let step = [(d * off[0] - b * off[1]) / determinant, (a * off[1] - c * off[0]) / determinant];
            at = [at[0] + step[0], at[1] + step[1]];
            if step[0].abs().max(step[1].abs()) < 1e-12 {
                let inverse = [[d, -b * fx / fy], [-c * fy / fx, a]].map(|row| row.map(|value| value / determinant));
                return Some(((at[0] * fx + self.centre[0], at[1] * fy + self.centre[1]), inverse));
            }
        }
        None
    }

    /// Returns where a point of the picture would be without distortion, pixels from 0; `None` if the model shows no point there.
    pub fn undistort(&self, point: (f64, f64)) -> Option<(f64, f64)> {
        self.inverse(point).map(|(point, _)| point)
    }

    /// Removes the distortion from a position and its covariance. A position that the model cannot show is no result.
    pub(super) fn straighten(&self, position: &Position) -> Position {
        let Some((centre, [[a, b], [c, d]])) = self.inverse(position.centre) else {
            return Position { usable: false, ..position.clone() };
        };
        // J C Jᵀ
        let turned = |[xx, xy, yy]: [f64; 3]| {
            [
                a * a * xx + 2.0 * a * b * xy + b * b * yy,
                a * c * xx + (a * d + b * c) * xy + b * d * yy,
                c * c * xx + 2.0 * c * d * xy + d * d * yy,
            ]
        };
        Position { centre, covariance: position.covariance.map(turned), ..position.clone() }
    }
}

/// Returns the text after a name: a key of YAML or JSON, or a tag of XML.
fn after<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    let own = |c: char| c.is_alphanumeric() || c == '_';
    let whole = |(at, _): &(usize, &str)| {
        let (before, rest) = (text[..*at].chars().next_back(), text[at + name.len()..].chars().next());
        !before.is_some_and(own) && !rest.is_some_and(own)
    };
    text.match_indices(name).find(whole).map(|(at, _)| &text[at + name.len()..])
}

/// Returns the numbers of a matrix, which follow the word data.
fn data_of(matrix: &str) -> &str {
    after(matrix, "data").unwrap_or_default()
}

/// Reads numbers up to the end of a list or of a tag. `None` if there is none, or something else.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let text = text.trim_start_matches(|c: char| !(c.is_ascii_digit() || matches!(c, '-' | '+' | '.')));
    let end = text.find(['<', ']', '}', ':', '"']).unwrap_or(text.len());
    let words = text[..end].split(|c: char| c.is_whitespace() || c == ',').filter(|word| !word.is_empty());
    let all: Vec<f64> = words.map_while(|word| word.parse().ok().filter(|value: &f64| value.is_finite())).collect();
    (!all.is_empty()).then_some(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: Lens = Lens {
        focal: [800.0, 790.0],
        centre: [319.5, 239.5],
        distortion: [-0.28, 0.09, 0.001, -0.002, -0.01],
        size: Some([640, 480]),
    };

    /// OpenCV's formula, written out: the picture of a point of the plane z = 1.
    fn shown(lens: &Lens, x: f64, y: f64) -> (f64, f64) {
        let [k1, k2, p1, p2, k3] = lens.distortion;
        let r2 = x.powi(2) + y.powi(2);
        let factor = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
        let u = x * factor + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x.powi(2));
        let v = y * factor + p1 * (r2 + 2.0 * y.powi(2)) + 2.0 * p2 * x * y;
        (u * lens.focal[0] + lens.centre[0], v * lens.focal[1] + lens.centre[1])
    }

    #[test]
    fn distortion_in_closed_form_is_removed() {
        for (x, y) in [(0.0, 0.0), (0.3, -0.2), (-0.39, 0.29), (0.1, 0.25)] {
            let (u, v) = LENS.undistort(shown(&LENS, x, y)).expect("in the picture");
            assert!((u - (x * 800.0 + 319.5)).abs() < 1e-8 && (v - (y * 790.0 + 239.5)).abs() < 1e-8, "{u} {v}");
        }
        // One coefficient, one axis: u = x + k1 x³, and a spread of du is one of dx = du / (1 + 3 k1 x²).
        let simple = Lens { distortion: [-0.2, 0.0, 0.0, 0.0, 0.0], ..LENS };
        let centre = shown(&simple, 0.4, 0.0);
        let position = Position {
            frame: 1,
            time: 0.0,
            centre,
            covariance: Some([4.0, 0.0, 9.0]),
            p_lost: 0.0,
            status: String::new(),
            usable: true,
        };
        let straight = simple.straighten(&position);
        let [xx, xy, yy] = straight.covariance.expect("a covariance");
        assert!((xx - 4.0 / (1.0 - 0.6 * 0.16_f64).powi(2)).abs() < 1e-9 && xy.abs() < 1e-12);
        assert!((yy - 9.0 / (1.0 - 0.2 * 0.16_f64).powi(2)).abs() < 1e-9 && straight.usable);
        // u = x - 0.2 x³ has its largest value at x = 1.29: nothing is shown beyond it.
        assert_eq!(simple.undistort((319.5 + 800.0 * 0.9, 239.5)), None);
        let beyond = Position { centre: (319.5 + 800.0 * 0.9, 239.5), ..position };
        assert!(!simple.straighten(&beyond).usable);
    }

    #[test]
    fn derivatives_are_those_of_the_map() {
        let (at, step) = ((30.0, 440.0), 1e-4);
        let (_, derivatives) = LENS.inverse(at).expect("in the picture");
        for axis in 0..2 {
            let moved = |by: f64| {
                let point = if axis == 0 { (at.0 + by, at.1) } else { (at.0, at.1 + by) };
                LENS.undistort(point).expect("in the picture")
            };
            let (a, b) = (moved(step), moved(-step));
            let slopes = [(a.0 - b.0) / (2.0 * step), (a.1 - b.1) / (2.0 * step)];
            (0..2).for_each(|i| assert!((slopes[i] - derivatives[i][axis]).abs() < 1e-6, "{derivatives:?} {slopes:?}"));
        }
    }

    #[test]
    fn files_of_opencv_are_read() {
        let matrix = "8.0e+02, 0., 3.195e+02, 0., 790., 239.5, 0., 0., 1.";
        let yaml = format!(
            "%YAML:1.0\n---\ncalibration_time: \"Sat 28 Nov\"\nimage_width: 640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   \
             rows: 3\n   cols: 3\n   dt: d\n   data: [ {} ]\ndistortion_coefficients: !!opencv-matrix\n   rows: 5\n   cols: 1\n   dt: d\n   \
             data: [ -0.28, 9.0e-02, 0.001,\n       -0.002, -0.01 ]\navg_reprojection_error: 0.3\n",
            matrix.replace("0., 790", "0.,\n       790")
        );
        let xml = format!(
            "<?xml version=\"1.0\"?>\n<opencv_storage>\n<image_Width>640</image_Width>\n<image_Height>480</image_Height>\n<Camera_Matrix \
             type_id=\"opencv-matrix\">\n  <rows>3</rows><cols>3</cols><dt>d</dt>\n  <data>\n    {}</data></Camera_Matrix>\n\
             <Distortion_Coefficients type_id=\"opencv-matrix\"><rows>5</rows><cols>1</cols><dt>d</dt>\n  <data>\n    -0.28 0.09 0.001 \
             -0.002 -0.01</data></Distortion_Coefficients>\n</opencv_storage>\n",
            matrix.replace(',', "")
        );
        let json = format!(
            "{{\"image_width\": 640, \"image_height\": 480, \"cameraMatrix\": {{\"type_id\": \"opencv-matrix\", \"rows\": 3, \"cols\": 3, \
             \"dt\": \"d\", \"data\": [{}]}}, \"distCoeffs\": {{\"rows\": 1, \"cols\": 5, \"dt\": \"d\", \"data\": [-0.28, 0.09, 0.001, \
             -0.002, -0.01]}}}}",
            matrix.replace(".,", ".0,").replace("1.", "1.0")
        );
        for text in [&yaml, &xml, &json] {
            assert_eq!(Lens::parse(text), Ok(LENS), "{text}");
        }
        let refused = |text: String, why: &str| {
            let problem = Lens::parse(&text).expect_err("refused");
            assert!(problem.contains(why), "{problem}");
        };
        refused("camera: 1\n".into(), "no camera_matrix");
        refused(yaml.replace("-0.01 ]", "-0.01, 0.1, 0.2, 0.3 ]"), "8 distortion coefficients");
        refused(yaml.replace("[ 8.0e+02, 0.", "[ 8.0e+02, 0.5"), "not that of OpenCV");
        refused(yaml.replace("3.195e+02", ".nan"), "2 numbers");
        // What ROS and OpenCV call a fisheye lens has coefficients of another meaning.
        assert_eq!(Lens::parse(&format!("{yaml}distortion_model: plumb_bob\n")), Ok(LENS));
        refused(format!("{yaml}distortion_model: equidistant\n"), "equidistant");
        assert_eq!(Lens::parse(&xml.replace("<Camera", "<fisheye_model>0</fisheye_model>\n<Camera")), Ok(LENS));
        refused(xml.replace("<Camera", "<fisheye_model>1</fisheye_model>\n<Camera"), "fisheye");
    }
}
