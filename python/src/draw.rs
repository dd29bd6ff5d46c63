//! Boxes, particles and paths drawn on a copy of a picture.

use foveate::report::draw::{Colour, Drawing, Point, text_width};
use foveate::report::heat::ramp;
use numpy::{PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::errors::{OrRaise, input};
use crate::pictures::{Channels, Picture, interleaved};

const BLACK: Colour = [0; 3];
const WHITE: Colour = [255; 3];

/// Returns the width of lines in a picture with this number of rows, relative to 480 rows.
fn bold(height: usize) -> f64 {
    (height as f64 / 480.0).clamp(0.8, 3.0)
}

/// Draws a line with a dark rim, legible on any background.
fn rimmed(page: &mut Drawing, points: &[Point], thick: f64, bold: f64, colour: Colour) {
    page.line(points, (thick + 1.8) * bold, BLACK, 0.4);
    page.line(points, thick * bold, colour, 1.0);
}

/// Writes a text above a box, or below if there is no room.
fn label(page: &mut Drawing, [x, y, _, h]: [f64; 4], text: &str, bold: f64) {
    let size = 9.0 * bold;
    let top = if y >= 2.4 * size { y - 2.2 * size } else { y + h + 0.8 * size };
    page.fill(x - 0.4 * size, top - 0.4 * size, text_width(text, size) + 0.8 * size, 1.8 * size, BLACK, 0.55);
    page.text((x, top), text, size, WHITE);
}

type Rows<'py> = PyReadonlyArray2<'py, f64>;

fn points(rows: &Rows<'_>) -> Vec<Vec<f64>> {
    rows.as_array().rows().into_iter().map(|row| row.to_vec()).collect()
}

/// The picture with these marks: boxes (left, top, width, height) with a colour and a text each, discs (x, y and a share of 1 that
/// colours them), and paths with a colour each. A colour picture in the order of the channels; of a grey one, and of one with alpha, without.
#[pyfunction]
pub(crate) fn draw_marks<'py>(
    image: &Bound<'py, PyAny>,
    channels: &str,
    boxes: Rows<'py>,
    colours: Vec<Colour>,
    texts: Vec<String>,
    discs: Rows<'py>,
    paths: Vec<(Rows<'py>, Colour)>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = image.py();
    let widths = [(&boxes, 4), (&discs, 3)].into_iter().chain(paths.iter().map(|(path, _)| (path, 2)));
    if widths.into_iter().any(|(rows, width)| rows.shape()[1] != width)
        || [colours.len(), texts.len()] != [boxes.shape()[0]; 2]
    {
        return Err(input(py, "marks are boxes of 4 numbers with a colour and a text each, discs of 3, paths of 2"));
    }
    let channels = Channels::named(py, channels)?;
    let picture = Picture::new(image, channels)?;
    let pixels = picture.pixels();
    let (boxes, discs) = (points(&boxes), points(&discs));
    let paths: Vec<_> = paths.iter().map(|(path, colour)| (points(path), *colour)).collect();
    let draw = || {
        let mut kept = None;
        let image = pixels.read(&mut kept)?;
        let (width, height) = (image.width(), image.height());
        let (mut page, bold) = (Drawing::new(width, height, BLACK), bold(height));
        page.paste(image, 0, 0, width, height);
        for disc in &discs {
            let share = disc[2].clamp(0.0, 1.0);
            page.disc(
                (disc[0], disc[1]),
                bold * (1.3 + 0.9 * share),
                ramp((1.0 + 2.0 * share) / 3.0),
                0.4 + 0.5 * share,
            );
        }
        for (path, colour) in &paths {
            let path: Vec<Point> = path.iter().map(|p| (p[0], p[1])).collect();
            rimmed(&mut page, &path, 1.6, bold, *colour);
        }
        for ((b, colour), text) in boxes.iter().zip(&colours).zip(&texts) {
            // The centre of the top-left pixel is (0, 0); a box begins at its edge.
            let (x, y, right, bottom) = (b[0] - 0.5, b[1] - 0.5, b[0] + b[2] - 0.5, b[1] + b[3] - 0.5);
            rimmed(&mut page, &[(x, y), (right, y), (right, bottom), (x, bottom), (x, y)], 2.0, bold, *colour);
            if !text.is_empty() {
                label(&mut page, [x, y, b[2], b[3]], text, bold);
            }
        }
        Ok(page.into_image())
    };
    let drawn = py.detach(draw).or_raise(py)?;
    Ok(interleaved(&drawn, channels.order_of_three()).into_array(py))
}
