//! Runs beside the truth, sequence by sequence: overlap over time, P(lost) and status below it, and pictures at regular intervals and of
//! the worst frame. They form one page, `report.html`, with the hardest sequence first.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use super::confidence::{EPISODE, Judged, LOST};
use super::metrics::score;
use super::{Evaluation, Score, Sequence};
use foveate_base::text::counted;
use foveate_base::{Error, Result};
use foveate_core::Seen;
use foveate_core::control::Status;
use foveate_core::geometry::BBox;
use foveate_core::scene::Image;
use foveate_report::chart::{Axis, Chart, Mark, render};
use foveate_report::{Observer, Strip, card, document, drawing, escape};
use foveate_video::{encode_jpeg, open};

/// Number of pictures of a sequence at regular intervals; the worst frame is added.
const STILLS: usize = 7;
/// JPEG quality of the pictures.
const QUALITY: u8 = 75;

/// A run on a sequence, from its first frame on.
#[derive(Clone, Debug, PartialEq)]
pub struct Case {
    /// The sequence.
    pub sequence: Sequence,
    /// The seed of the run.
    pub seed: u64,
    /// The box in each frame, 0-based, including the first.
    pub boxes: Vec<BBox>,
    /// The reports in each frame from the second on.
    pub judged: Vec<Judged>,
}

impl Case {
    /// Returns the IoU in each frame; `None` if the target is not visible.
    fn overlaps(&self) -> Vec<Option<f64>> {
        self.boxes.iter().zip(&self.sequence.truth).map(|(b, truth)| truth.map(|truth| b.iou(&truth))).collect()
    }

    /// Returns the index of the first frame with the smallest overlap.
    fn worst(&self) -> Option<usize> {
        let known = self.overlaps().into_iter().enumerate().filter_map(|(i, overlap)| Some((i, overlap?)));
        known.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(i, _)| i)
    }

    /// Describes when the target was lost, and when that was reported. Frames count from 1.
    fn verdict(&self) -> String {
        let (mut at, mut losses) = (2, vec![]);
        for run in self.judged.chunk_by(|a, b| a.lost() == b.lost()) {
            if run[0].lost() && run.len() >= EPISODE {
                let said = match run.iter().position(|j| !j.status.is_usable()) {
                    Some(0) => "reported at once".into(),
                    Some(n) => format!("reported {} later", counted(n, "frame")),
                    None => "not reported".to_owned(),
                };
                losses.push(format!("{} to {} ({said})", at, at + run.len() - 1));
            }
            at += run.len();
        }
        match losses.is_empty() {
            true => format!("Never lost for {EPISODE} frames or more."),
            false => format!("Lost in frames {}.", losses.join(", ")),
        }
    }

    /// Plots overlap above P(lost), against frames counted from 1, as SVG text; narrow enough for a phone.
    pub fn plot(&self) -> String {
        let last = self.boxes.len() as f64;
        let chart = |x_label: &str, y_label: &str, marks| {
            let (x, y) = (Axis::new(x_label).between(0.0, last), Axis::new(y_label).between(0.0, 1.0));
            Chart { x, y, marks, ..Chart::default() }
        };
        let overlaps = self.overlaps().into_iter().enumerate();
        let overlaps = overlaps.map(|(i, overlap)| ((i + 1) as f64, overlap.unwrap_or(f64::NAN)));
        let threshold = Mark::line("#B33C00", 1.0, [(0.0, LOST), (last, LOST)]).dashed("6 4");
        let upper = vec![threshold, Mark::line("#0072B2", 1.8, overlaps)];
        let (mut lower, mut at) = (vec![], 1.5);
        for run in self.judged.chunk_by(|a, b| a.status == b.status) {
            let end = at + run.len() as f64;
            if let Some(colour) = colour(run[0].status) {
                lower.push(Mark::band(colour, 0.35, [(at, 0.0, 1.0), (end, 0.0, 1.0)]));
            }
            at = end;
        }
        let p_lost = self.judged.iter().enumerate().map(|(i, j)| ((i + 2) as f64, j.p_lost));
        lower.push(Mark::line("#000000", 1.8, p_lost));
        render(&[chart("", "overlap (IoU)", upper), chart("frame", "P(lost)", lower)], 1, [480.0, 150.0])
    }

    /// Returns pictures with the true and the estimated box, by index of the frame: at regular intervals, and the worst one.
    ///
    /// # Errors
    /// The sequence cannot be read again.
    pub fn stills(&self) -> Result<Vec<(usize, Image)>> {
        let last = self.boxes.len().saturating_sub(1);
        let at: Vec<usize> = (0..STILLS).map(|i| i * last / (STILLS - 1)).chain(self.worst()).collect();
        let mut strip = Strip::at(at, self.sequence.truth.clone());
        for (frame, bbox) in open(&self.sequence.images)?.zip(&self.boxes) {
            let frame = frame?;
            strip.observe(&frame, &[Seen::given(frame.image.shape(), bbox)])?;
        }
        Ok(strip.into_stills())
    }

    fn html(&self, score: &Score, best: Option<(&str, f64)>) -> Result<String> {
        let name = escape(&self.sequence.name);
        let (overlaps, worst) = (self.overlaps(), self.worst());
        let still = |(i, image): (usize, Image)| {
            let overlap = overlaps[i].map_or("not visible".into(), |o| format!("IoU {o:.2}"));
            let said = i.checked_sub(1).and_then(|i| self.judged.get(i));
            let said = said.map_or(String::new(), |j| format!(", P(lost) {:.2}, {}", j.p_lost, j.status.name()));
            let (class, what) = if worst == Some(i) { (" class=\"worst\"", ", the worst") } else { ("", "") };
            let caption = format!("frame {}{what}: {overlap}{said}", i + 1);
            let data = STANDARD.encode(encode_jpeg(&image, QUALITY));
            format!(
                "<figure{class}><img alt=\"{name}, {caption}\" src=\"data:image/jpeg;base64,{data}\"><figcaption>{caption}</figcaption></figure>"
            )
        };
        let stills: String = self.stills()?.into_iter().map(still).collect();
        let best = best.map_or(String::new(), |(who, auc)| format!(" (best of the others: {auc:.3}, {})", escape(who)));
        let figures = format!(
            "<p>{} AUC {:.3}{best}, precision {:.3}, failure in {} of {}; seed {}.</p>",
            self.verdict(),
            score.auc,
            score.p20,
            score.failures,
            counted(score.frames, "frame"),
            self.seed,
        );
        let chart = drawing(&self.plot(), &format!("{}: overlap and P(lost) over time", self.sequence.name));
        Ok(format!(
            "<section class=\"card\" id=\"{name}\"><h2>{name}</h2>\n{figures}<div class=\"case\">{chart}<div class=\"stills\">{stills}</div></div></section>\n"
        ))
    }
}

/// Returns Okabe and Ito's orange, vermilion or green; `None` while tracking.
fn colour(status: Status) -> Option<&'static str> {
    match status {
        Status::Tracking => None,
        Status::Occluded => Some("#E69F00"),
        Status::Lost => Some("#D55E00"),
        Status::Reacquired => Some("#009E73"),
    }
}

/// The legend of the boxes and of the charts' shading.
const KEY: &str = "\
<p>Boxes: <i class=\"key\" style=\"background:#3fd19b\"></i>true, <i class=\"key\" style=\"background:#39b6ff\"></i>found.
The shade behind P(lost) is the status: <i class=\"key\" style=\"background:var(--gaze)\"></i>occluded, \
<i class=\"key\" style=\"background:var(--lost)\"></i>lost, <i class=\"key\" style=\"background:var(--second)\"></i>re-acquired; none while it tracks.
The line across the overlap is an IoU of 0.1: below it the target is lost.</p>
";

/// Returns the page of these runs, each beside the best of `others`. Above the runs: charts over all of them (description and SVG text),
/// and a table by attribute (HTML). Below: the description of the evaluation (HTML).
///
/// # Errors
/// A sequence cannot be read again, or a run does not have one box per frame.
pub fn page(
    cases: &[Case],
    others: &[Evaluation],
    charts: &[(&str, String)],
    by_attribute: &str,
    run: &str,
) -> Result<String> {
    let mut scored = Vec::new();
    for case in cases {
        let boxes: Vec<_> = case.boxes.iter().copied().map(Some).collect();
        let at_sequence = |e: Error| Error::Invalid(format!("{}: {e}", case.sequence.images.display()));
        scored.push((case, score(&boxes, &case.sequence.truth).map_err(at_sequence)?.0));
    }
    scored.sort_by(|a, b| a.1.auc.total_cmp(&b.1.auc));
    let (mut rows, mut sections) = (String::new(), String::new());
    for (case, score) in &scored {
        let name = &case.sequence.name;
        let of_other = |e: &'_ Evaluation| Some((e.tracker.clone(), e.of_sequence(name)?.auc));
        let best = others.iter().filter_map(of_other).max_by(|a, b| a.1.total_cmp(&b.1));
        let best = best.as_ref().map(|(who, auc)| (who.as_str(), *auc));
        let other = best.map_or("-".into(), |(who, auc)| format!("{auc:.3} {}", escape(who)));
        let (name, verdict) = (escape(name), case.verdict());
        let figures = format!("<td>{:.3}</td><td>{:.1} %</td><td>{other}</td>", score.auc, score.failure_pct);
        rows += &format!(
            "<tr><td class=\"words\"><a href=\"#{name}\">{name}</a><small>{verdict}</small></td>{figures}</tr>\n"
        );
        sections += &case.html(score, best)?;
    }
    let table = format!(
        "<div class=\"scroll\"><table>\n<tr><th>sequence, losses</th><th>AUC</th><th>failure (IoU 0)</th><th>best of the others</th></tr>\n{rows}</table></div>\n"
    );
    let drawn: String = charts.iter().map(|(what, svg)| drawing(svg, what)).collect();
    let body = [
        card("Curves", &format!("<div class=\"drawings\">{drawn}</div>\n")),
        card("Sequences", &table),
        if by_attribute.is_empty() { String::new() } else { card("By attribute", by_attribute) },
        card("How to read the runs below", KEY),
        sections,
        run.to_owned(),
    ];
    let verdict = "The tracker got the true box in frame 1 and nothing more. The hardest sequence comes first.";
    Ok(document("Results, sequence by sequence", verdict, "", &body.concat()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use foveate_core::control::Cues;
    use foveate_video::encode_png;

    fn bbox(x: f64) -> BBox {
        BBox { x, y: 5.0, w: 20.0, h: 20.0 }
    }

    /// Twelve frames; from the fifth to the eleventh the box is far off, which is reported at the eighth.
    fn case() -> Case {
        let at = |i: usize| if (4..11).contains(&i) { bbox(200.0) } else { bbox(0.0) };
        let truth = vec![Some(bbox(0.0)); 12];
        let judged = |i: usize| Judged {
            p_lost: 0.5,
            status: if (7..11).contains(&i) { Status::Occluded } else { Status::Tracking },
            cues: Cues::default(),
            iou: at(i).iou(&bbox(0.0)),
            off: None,
            covariance: [1.0, 0.0, 1.0],
            place: Default::default(),
        };
        let sequence = Sequence::named("A<b", truth);
        Case { sequence, seed: 3, boxes: (0..12).map(at).collect(), judged: (1..12).map(judged).collect() }
    }

    #[test]
    fn losses_are_reported() {
        let mut case = case();
        assert_eq!(case.verdict(), "Lost in frames 5 to 11 (reported 3 frames later).");
        assert_eq!(case.worst(), Some(4));
        case.judged.iter_mut().for_each(|j| j.status = Status::Tracking);
        assert!(case.verdict().contains("not reported"));
        case.judged.iter_mut().for_each(|j| j.iou = 1.0);
        assert!(case.verdict().starts_with("Never lost"));
        case.sequence.truth[2] = None;
        assert!(case.plot().contains("overlap (IoU)"), "also with a gap in the truth");
    }

    #[test]
    fn a_page_has_everything_in_it() {
        let dir = tempfile::tempdir().expect("a temporary folder");
        let mut case = case();
        assert!(
            page(std::slice::from_ref(&case), &[], &[], "", "")
                .expect_err("no pictures")
                .to_string()
                .contains("nowhere")
        );
        case.sequence.images = dir.path().into();
        for i in 0..12 {
            std::fs::write(dir.path().join(format!("{i:02}.png")), encode_png(&Image::grey(60, 40, 90)))
                .expect("written");
        }
        let charts = [("a chart", case.plot())];
        let html = page(&[case.clone()], &[], &charts, "<p>by attribute</p>", "<p>run</p>").expect("a page");
        assert!(
            html.contains("A&lt;b")
                && !html.contains("A<b")
                && !html.contains("{{")
                && html.contains("<p>by attribute</p>")
                && html.contains("<p>run</p>")
        );
        // Every second frame of twelve or so, of which the fifth is the worst.
        assert_eq!((html.matches("image/jpeg").count(), html.matches("the worst").count()), (8, 2), "{html}");
        assert_eq!(html.matches("class=\"drawing\"").count(), 2, "the chart over all, and that of the run");
        assert!(
            html.contains("prefers-color-scheme: dark")
                && !html.to_lowercase().contains("\"#0072b2\"")
                && !html.contains("\"white\"")
        );
        case.boxes.pop();
        assert!(page(&[case], &[], &[], "", "").expect_err("too short").to_string().contains("11 boxes"));
    }
}
