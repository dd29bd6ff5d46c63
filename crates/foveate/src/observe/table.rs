//! boxes.txt and track.csv: a run as plain numbers, one line a frame, readable from the first frame on.

use std::borrow::Cow;
use std::fmt::Write as _;
use std::path::PathBuf;

use super::Observer;
use super::sink::Sink;
use crate::Result;
use crate::geometry::{BBox, State};
use crate::scene::Frame;
use crate::step::Step;

/// boxes.txt as OTB has it: `x,y,w,h` a line, `x,y` the top-left corner counted from 1, in pixels; frame 1 included.
#[derive(Debug)]
pub struct Boxes {
    file: Sink,
}

impl Boxes {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        Ok(Self { file: Sink::create(path)? })
    }
    fn put(&mut self, b: &BBox) -> Result<()> {
        self.file.write(format!("{:.3},{:.3},{:.3},{:.3}\n", b.x + 1.0, b.y + 1.0, b.w, b.h).as_bytes())?;
        self.file.flush()
    }
}

impl Observer for Boxes {
    fn start(&mut self, _: &Frame, bbox: &BBox) -> Result<()> {
        self.put(bbox)
    }
    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        self.put(&step.bbox())
    }
    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}

/// The names of a state's numbers, in their order.
const STATE: [&str; 6] = ["x", "y", "vx", "vy", "log_scale", "angle"];

/// track.csv: what was estimated, and how sure it is. Columns, by name in the first line:
///
/// - `frame` counted from 1, `time` in seconds; `left,top,width,height`: the box, counted from 0, in pixels;
/// - `x … angle`: the state ([`State`]); `cov_x_x … cov_angle_angle`: the upper triangle of its covariance, row by row;
///   `sd_x,sd_y`: position uncertainty in pixels;
/// - `ess`: effective sample size; `log_evidence` in nats; `doubt`; `lost`: 1 if believed out of sight, else 0;
///   `p_lost`: the probability of being lost; `standing`: 0 tracking, 1 occluded, 2 lost, 3 found again;
/// - `gaze_u,gaze_v`: the chosen gaze in template units; `reward`: what it earned; `distance` of what was seen there to
///   the template; `class`, its name, or its number counted from 0 where classes have no names, and
///   `class_probability`: the likeliest over all frames so far; empty without a recogniser. A name with a comma, a quote or a
///   line's end is put in quotes.
///
/// Where the box was given instead of tracked, all from `cov_x_x` on is empty. Numbers read back bit for bit.
#[derive(Debug)]
pub struct Table {
    file: Sink,
    line: String,
}

impl Table {
    /// Starts the file. Fails where its folder cannot be written.
    pub fn create(path: impl Into<PathBuf>) -> Result<Self> {
        let mut file = Sink::create(path)?;
        file.write(header().as_bytes())?;
        Ok(Self { file, line: String::new() })
    }

    fn put(
        &mut self,
        frame: &Frame,
        bbox: &BBox,
        state: &State,
        rest: &[f64],
        class: Option<(Cow<'_, str>, f64)>,
    ) -> Result<()> {
        self.line.clear();
        let _ = write!(self.line, "{}", frame.index + 1);
        let numbers = [frame.time, bbox.x, bbox.y, bbox.w, bbox.h];
        for number in numbers.iter().chain(&state.to_array()).chain(rest) {
            // Rust prints the shortest digits that read back as the same number.
            let _ = write!(self.line, ",{number}");
        }
        match class {
            Some((name, p)) => {
                let _ = write!(self.line, ",{},{p}", quoted(&name));
            }
            None => self.line.extend(std::iter::repeat_n(',', TRACKED - rest.len())),
        }
        self.line.push('\n');
        self.file.write(self.line.as_bytes())?;
        self.file.flush()
    }
}

/// Columns that a tracked frame has and a given one has not: covariance and the fourteen after it.
const TRACKED: usize = 21 + 14;

/// A text as a field of CSV.
fn quoted(text: &str) -> Cow<'_, str> {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\"")).into()
    } else {
        text.into()
    }
}

fn header() -> String {
    let mut names: Vec<String> = ["frame", "time", "left", "top", "width", "height"].map(String::from).to_vec();
    names.extend(STATE.map(String::from));
    for (i, a) in STATE.iter().enumerate() {
        names.extend(STATE[i..].iter().map(|b| format!("cov_{a}_{b}")));
    }
    let rest =
        "sd_x,sd_y,ess,log_evidence,doubt,lost,p_lost,standing,gaze_u,gaze_v,reward,distance,class,class_probability";
    format!("{},{rest}\n", names.join(","))
}

impl Observer for Table {
    fn start(&mut self, frame: &Frame, bbox: &BBox) -> Result<()> {
        self.put(frame, bbox, &State::of(bbox), &[], None)
    }

    fn observe(&mut self, step: &Step<'_>) -> Result<()> {
        let c = &step.covariance;
        let mut rest = Vec::with_capacity(TRACKED);
        for (i, row) in c.iter().enumerate() {
            rest.extend_from_slice(&row[i..]);
        }
        let gaze = step.plan.chosen();
        rest.extend([c[0][0].sqrt(), c[1][1].sqrt(), step.ess, step.log_evidence, step.watch.doubt]);
        rest.extend([f64::from(u8::from(step.lost())), step.trust.p_lost, f64::from(step.trust.standing as u8)]);
        rest.extend([gaze.u, gaze.v]);
        rest.extend([step.rewards[step.plan.chosen_index()], step.percept.distance]);
        let class = step.class().map(|(class, p)| (step.class_name(class), p));
        self.put(step.frame, &step.bbox(), &step.estimate, &rest, class)
    }

    fn finish(&mut self) -> Result<()> {
        self.file.finish()
    }
}
