//! index.html: a self-contained page for offline reading.

use std::collections::BTreeSet;
use std::time::Duration;

use crate::eval::tally;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use foveate::report::{card, document, drawing, escape};

use super::line::Group;
use super::multi_table;
use super::output::{Content, Picture, Section, Table};
use super::plan::Measure;
use super::results::{Line, Results};

/// The notice of --quick.
const SMALL: &str = "<p><strong>Small variant (--quick):</strong> fewer digits, seeds and frames, and wider ranges. It shows that the program \
    works, not that the paper is reproduced.</p>";

/// Returns the whole page.
pub(super) fn html(sections: &[Section], digits: &str, quick: bool, took: Duration) -> String {
    let link = |s: &Section| format!("<a href=\"#{0}\">{0}</a>", escape(&s.name));
    let links: String = sections.iter().map(link).collect();
    let checks = sections.iter().filter_map(Section::results).flat_map(|r| r.checks.iter().map(move |c| (r, c)));
    let check = |(results, check): (&Results, &super::results::Check)| {
        let class = if check.met { "met" } else { "missed" };
        let name = results.title.split(':').next().unwrap_or("");
        format!("<li class=\"{class}\">{}: {}</li>", escape(name), escape(&check.text()))
    };
    let checks: String = checks.map(check).collect();
    let checks = if checks.is_empty() { checks } else { format!("<h3>Expected ranges</h3><ul>{checks}</ul>") };
    let small = if quick { SMALL } else { "" };
    let contents = card("Contents", &format!("{small}<nav class=\"links\">{links}</nav>{checks}"));
    let body: String = std::iter::once(contents).chain(sections.iter().map(section)).collect();
    let verdict = format!(
        "Denil, Bazzani, Larochelle and de Freitas (2012) beside foveate {}. Videos are made of {}.",
        env!("CARGO_PKG_VERSION"),
        escape(digits)
    );
    let (minutes, command) = (took.as_secs_f64() / 60.0, escape(&foveate_cli::command()));
    let about = format!("Made in {minutes:.1} minutes by <code>{command}</code>.");
    document("Learning where to attend, reproduced", &verdict, &about, &body)
}

fn section(section: &Section) -> String {
    let body = match &section.content {
        Content::Table(table) if !table.results.multi.is_empty() => multi(table) + &pictures(&table.pictures),
        Content::Table(table) => tables(table),
        Content::Figure(figure) => {
            let missing: String = figure.missing.iter().map(|m| format!("<p>Not shown: {}</p>", escape(m))).collect();
            let text = Some(&figure.text).filter(|text| !text.is_empty());
            missing + &text.map_or(String::new(), |t| format!("<pre>{}</pre>", escape(t))) + &pictures(&figure.pictures)
        }
    };
    let [name, title, about] = [&section.name, &section.title, &section.about].map(|text| escape(text));
    format!("<section class=\"card\" id=\"{name}\"><h2>{title}</h2><p>{about}</p>{body}</section>\n")
}

fn pictures(all: &[Picture]) -> String {
    all.iter().map(|p| picture(&p.file, &p.caption, &p.bytes)).collect()
}

fn multi(table: &Table) -> String {
    let Results { first_seed, seeds, frames, digits_from, multi, .. } = &table.results;
    let cells = |kind: &str, cells: &mut dyn Iterator<Item = &str>| -> String {
        cells.map(|cell| format!("<{kind}>{}</{kind}>", escape(cell))).collect()
    };
    let rows: String = (multi.iter().zip(&table.speeds))
        .map(|(line, speed)| {
            let speed = speed.map_or(String::new(), |s| format!("{s:.0}"));
            let all = multi_table::cells(line);
            let row = cells("td", &mut all.iter().map(String::as_str).chain([speed.as_str()]));
            format!("<tr>{row}</tr>")
        })
        .collect();
    format!(
        "<p class=\"soft\">Seeds {first_seed} to {}, {frames} frames; {}. {}</p><div class=\"scroll\"><table class=\"numbers\"><tr>{}</tr>{rows}</table></div>",
        first_seed + (seeds - 1),
        escape(digits_from),
        escape(multi_table::LEGEND),
        cells("th", &mut multi_table::HEADS.into_iter().chain(["frames/s"]))
    )
}

fn picture(file: &str, caption: &str, bytes: &[u8]) -> String {
    let shown = match std::str::from_utf8(bytes) {
        Ok(svg) if file.ends_with(".svg") => format!("<div class=\"scroll\">{}</div>", drawing(svg, caption)),
        _ => format!("<img alt=\"{}\" src=\"data:image/png;base64,{}\">", escape(caption), STANDARD.encode(bytes)),
    };
    format!("<figure>{shown}<figcaption>{}</figcaption></figure>", escape(caption))
}

fn tables(table: &Table) -> String {
    let results = &table.results;
    let mut out = format!(
        "<p class=\"soft\">Digits {}, {} videos of each, {} frames; {}. Off at end: the last 20 frames are more than 15 px off on average. Bold: the best mean of a column among lines with these settings.</p>",
        results.digits.iter().map(u8::to_string).collect::<Vec<_>>().join(", "),
        results.seeds,
        results.frames,
        escape(&results.digits_from)
    );
    for (i, scene) in results.scenes().into_iter().enumerate() {
        let lines: Vec<(&Line, Option<f64>)> =
            results.lines.iter().zip(table.speeds.iter().copied()).filter(|(line, _)| line.scene == scene).collect();
        out +=
            &format!("<h3>{}</h3><div class=\"scroll\">{}</div>", escape(scene), scene_table(results, &lines, i == 0));
        out += &forest(results, &lines, i == 0);
    }
    out
}

/// Draws means and intervals, with the paper's averages. Errors differ by orders of magnitude, so their axis is logarithmic.
fn forest(results: &Results, lines: &[(&Line, Option<f64>)], with_paper: bool) -> String {
    let (label, scale): (&str, fn(f64) -> f64) = match results.measure {
        Measure::Error => {
            ("mean error: 10 to this power, px (0 is 1 px, 1 is 10 px, 2 is 100 px)", |x| x.max(0.01).log10())
        }
        Measure::Accuracy => ("frames recognised, %", |x| x),
    };
    let colour = |group| match group {
        Group::Recommended => "#0072B2",
        Group::Authors => "#D55E00",
        Group::Printed => "#CC79A7",
        Group::Peer => "#009E73",
    };
    let mut rows: Vec<(String, [f64; 3], &str)> = vec![];
    for row in results.paper.iter().filter(|_| with_paper) {
        rows.push((format!("the paper: {}", row.row), [scale(row.average); 3], "#000000"));
    }
    for (line, _) in lines {
        let t = &line.tally;
        rows.push((line.name.clone(), [t.mean, t.interval[0], t.interval[1]].map(scale), colour(line.group)));
    }
    let svg = tally::plot(label, &rows);
    picture(
        "means.svg",
        "Means with 95 % intervals. In the colour of the text: the paper; blue: as recommended; vermilion: the authors' parameters; purple: as printed; green: other trackers.",
        svg.as_bytes(),
    )
}

fn scene_table(results: &Results, lines: &[(&Line, Option<f64>)], with_paper: bool) -> String {
    let digits: String = results.digits.iter().map(|d| format!("<th>{d}</th>")).collect();
    let details: BTreeSet<&String> = lines.iter().flat_map(|(line, _)| line.details.keys()).collect();
    let heads: String = details.iter().map(|name| format!("<th>{}</th>", escape(name))).collect();
    let mut out = format!(
        "<table class=\"numbers\"><tr><th></th>{digits}<th>mean</th><th>95 %</th><th>median</th><th>off at end</th>{heads}<th>difference [95 %]</th><th>from</th><th>frames/s</th></tr>"
    );
    let cell = |mean: f64, spread: Option<f64>, best: bool| {
        let spread = spread.filter(|s| *s > 0.0).map_or(String::new(), |s| format!("<small>({s:.2})</small>"));
        if best { format!("<td><b>{mean:.2}</b>{spread}</td>") } else { format!("<td>{mean:.2}{spread}</td>") }
    };
    let columns = results.digits.len() + details.len() + 8;
    if with_paper && !results.paper.is_empty() {
        out += &format!("<tr class=\"group\"><td colspan=\"{columns}\">the paper</td></tr>");
        for row in &results.paper {
            let cells: String = (results.digits.iter().map(|d| usize::from(*d)))
                .map(|d| row.digits.get(d).map_or("<td></td>".into(), |m| cell(*m, row.spread.get(d).copied(), false)))
                .collect();
            let (name, average) = (escape(&row.row), row.average);
            out += &format!(
                "<tr class=\"paper\"><td class=\"words\">{name}</td>{cells}<td>{average:.2}</td><td colspan=\"{}\"></td></tr>",
                details.len() + 6
            );
        }
    }
    for group in [Group::Recommended, Group::Authors, Group::Printed, Group::Peer] {
        let mine: Vec<_> = lines.iter().filter(|(line, _)| line.group == group).collect();
        if mine.is_empty() {
            continue;
        }
        out += &format!("<tr class=\"group\"><td colspan=\"{columns}\">{}</td></tr>", group.title());
        let better = |a: f64, b: f64| match results.measure {
            Measure::Error => a < b,
            Measure::Accuracy => a > b,
        };
        for (line, speed) in &mine {
            let t = &line.tally;
            let is_best = |value: f64, of: &dyn Fn(&Line) -> Option<f64>| {
                mine.len() > 1 && !mine.iter().any(|(l, _)| of(l).is_some_and(|v| better(v, value)))
            };
            let cells: String = (results.digits.iter())
                .map(|digit| {
                    let of = |l: &Line| l.tally.digits.iter().find(|d| d.digit == *digit).map(|d| d.mean);
                    let found = t.digits.iter().find(|d| d.digit == *digit);
                    found.map_or("<td></td>".into(), |d| cell(d.mean, Some(d.spread), is_best(d.mean, &of)))
                })
                .collect();
            let detail = |name: &&String| {
                line.details.get(*name).map_or("<td></td>".into(), |share| format!("<td>{share:.1} %</td>"))
            };
            let more: String = details.iter().map(detail).collect();
            let difference =
                t.against.map_or(String::new(), |d| format!("{:+.2} [{:+.2}, {:+.2}]", d.mean, d.low, d.high));
            out += &format!(
                "<tr><td class=\"words\">{}</td>{cells}{}<td>{:.2} to {:.2}</td><td>{:.2}</td><td>{:.0} %</td>{more}<td>{difference}</td><td>{}</td><td>{}</td></tr>",
                escape(&line.name),
                cell(t.mean, None, is_best(t.mean, &|l| Some(l.tally.mean))),
                t.interval[0],
                t.interval[1],
                t.median,
                100.0 * t.off_at_end,
                escape(line.other.as_deref().unwrap_or("")),
                speed.map_or(String::new(), |s| format!("{s:.0}")),
            );
        }
    }
    out + "</table>"
}
