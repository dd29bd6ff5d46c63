//! The prepared parts of a frame: box means and colour sums of one rectangle or, if states are scattered, of several.
//! The area between them costs nothing, so the cost of a frame depends on its states and not on the picture.

use super::colour::{Colour, RING, step};
use super::footprint::Footprint;
use super::integral::Integral;
use super::pyramid::{Pyramid, Region};
use crate::geometry::{Extent, Gaze, Size, State};
use crate::scene::{Image, Meter};

/// One rectangle of the frame.
#[derive(Default)]
pub(super) struct View {
    region: Region,
    pub pyramid: Pyramid,
    pub sums: Integral,
}

/// All rectangles that were seen of a frame.
#[derive(Default)]
pub(super) struct Views {
    views: Vec<View>,
    used: usize,
    size: Size,
    regions: Vec<Region>,
    /// Values read since the last call.
    read: Meter,
}

/// States that are seen in different rectangles, sorted out.
#[derive(Debug, Default)]
pub(super) struct Apart {
    pub view: Vec<usize>,
    pub which: Vec<usize>,
    pub states: Vec<State>,
    pub distances: Vec<f64>,
}

/// The properties of a retina and a target that looks need.
#[derive(Clone, Copy)]
pub(super) struct Looks<'a> {
    pub footprints: &'a [Footprint],
    pub extent: Extent,
    /// Farthest cell, template units.
    pub reach: f64,
}

/// Rectangles of one call, at most, and of a frame.
const MOST: usize = 16;
const ALL: usize = 64;
/// States are scattered if their rectangles have less than this share of the one around all of them, and that one has
/// so many pixels. Smaller ones are read quickly into existing memory.
const SCATTERED: f64 = 0.5;
const LARGE: usize = 1 << 18;
/// Margin in half boxes if states lie outside the prepared part, because others will follow.
const SLACK: f64 = 0.5;

/// The parts of a frame that a set of states needs.
struct Wanted {
    /// Pixels per template unit at the mean size and shape.
    unit: (f64, f64),
    /// Margin of the rings of the colour model, and the spacing of its samples.
    margin: (f64, f64),
    step: usize,
}

impl Looks<'_> {
    /// The parts of a frame that these states need, and their rectangles.
    fn survey(&self, size: Size, states: &[State], gazes: &[Gaze], found: &mut Vec<Region>) -> Wanted {
        let (mut sum, mut least, mut margin) = ([0.0; 2], f64::MAX, (0.0_f64, 0.0_f64));
        let windows = states.iter().map(|s| {
            let (w, h) = s.half(self.extent);
            let reach @ (dx, dy) = Region::reach(s, gazes, (w, h), self.reach);
            (sum, least) = ([sum[0] + s.log_scale, sum[1] + s.log_aspect], least.min(w.min(h)));
            margin = (margin.0.max(RING * w - dx), margin.1.max(RING * h - dy));
            Region::around(size, s, reach)
        });
        cluster(windows, size, found);
        let [log_scale, log_aspect] = sum.map(|sum| sum / states.len() as f64);
        let middle = State { log_scale, log_aspect, ..State::default() };
        Wanted { unit: middle.half(self.extent), margin, step: step(least) }
    }

    /// The rectangle that the colour model reads at a state, cut to the picture.
    fn ring(&self, Size { width, height }: Size, s: &State) -> [f64; 4] {
        let (w, h) = s.half(self.extent);
        let (w, h) = (RING * w, RING * h);
        let cut = |v: f64, side: usize| v.clamp(0.0, side as f64 - 1.0);
        [cut(s.x - w, width), cut(s.y - h, height), cut(s.x + w, width), cut(s.y + h, height)]
    }
}

impl Region {
    fn area(&self) -> usize {
        self.width * self.height
    }
    /// Left, top, right and bottom, so much farther out, cut to a picture of this size.
    fn grown(&self, (dx, dy): (f64, f64), size: Size) -> [f64; 4] {
        let (x, y) = (self.x as f64, self.y as f64);
        let (right, bottom) = (x + (self.width - 1) as f64 + dx, y + (self.height - 1) as f64 + dy);
        [(x - dx).max(0.0), (y - dy).max(0.0), right.min(size.width as f64 - 1.0), bottom.min(size.height as f64 - 1.0)]
    }
}

/// Fills `found` with rectangles around the windows of states: one, or several if they save half of it.
fn cluster(windows: impl Iterator<Item = Region>, size: Size, found: &mut Vec<Region>) {
    found.clear();
    if size.width * size.height < LARGE {
        return found.extend(windows.reduce(|all, window| all.union(&window)));
    }
    let mut all: Option<Region> = None;
    for window in windows {
        all = Some(all.map_or(window, |all| all.union(&window)));
        if found.iter().any(|region| region.contains(&window)) {
            continue;
        }
        let growth = |region: &Region| region.union(&window).area() - region.area();
        let full = found.len() == MOST;
        match found.iter_mut().min_by_key(|region| growth(region)) {
            Some(region) if full || growth(region) <= window.area() => *region = region.union(&window),
            _ => found.push(window),
        }
    }
    // Rectangles that cost as much apart as together are one.
    let mut i = 0;
    while i < found.len() {
        let joins = |other: &Region| found[i].union(other).area() <= found[i].area() + other.area();
        match (i + 1..found.len()).find(|j| joins(&found[*j])) {
            Some(j) => {
                let other = found.swap_remove(j);
                found[i] = found[i].union(&other);
                i = 0;
            }
            None => i += 1,
        }
    }
    let Some(all) = all else { return };
    let parts: usize = found.iter().map(Region::area).sum();
    if all.area() < LARGE || parts as f64 > SCATTERED * all.area() as f64 {
        found.clear();
        found.push(all);
    }
}

impl Views {
    /// Exchanges everything but the counts.
    pub(super) fn exchange(&mut self, other: &mut Self) {
        std::mem::swap(self, other);
        std::mem::swap(&mut self.read, &mut other.read);
    }

    /// Prepares the parts of a new frame that states need, and drops the previous frame.
    pub(super) fn see(
        &mut self,
        image: &Image,
        states: &[State],
        gazes: &[Gaze],
        looks: Looks<'_>,
        colour: Option<&mut Colour>,
    ) {
        let wanted = self.survey(image, states, gazes, looks);
        self.used = 0;
        self.add(image, &wanted, (0, 0), looks, colour);
    }

    /// The same in one rectangle, which is the answer.
    pub(super) fn see_whole(
        &mut self,
        image: &Image,
        states: &[State],
        gazes: &[Gaze],
        looks: Looks<'_>,
        colour: Option<&mut Colour>,
    ) -> &View {
        let wanted = self.survey(image, states, gazes, looks);
        let all = self.regions.iter().copied().reduce(|a, b| a.union(&b));
        self.regions.clear();
        self.regions.extend(all);
        self.used = 0;
        self.add(image, &wanted, (0, 0), looks, colour);
        &self.views[0]
    }

    /// Prepares the parts of the same frame that more states need, unless already there.
    pub(super) fn see_more(
        &mut self,
        image: &Image,
        states: &[State],
        gazes: &[Gaze],
        looks: Looks<'_>,
        colour: Option<&mut Colour>,
    ) {
        let wanted = self.survey(image, states, gazes, looks);
        let Self { regions, views, used, size, .. } = self;
        let colours = colour.is_some();
        let holds = |view: &View, region: Region| {
            view.pyramid.holds(region, looks.footprints, wanted.unit)
                && (!colours || view.sums.holds(region.grown(wanted.margin, *size), wanted.step))
        };
        regions.retain(|region| !views[..*used].iter().any(|view| holds(view, *region)));
        if self.used + self.regions.len() > ALL {
            return self.see(image, states, gazes, looks, colour);
        }
        let pad = ((SLACK * wanted.unit.0) as usize, (SLACK * wanted.unit.1) as usize);
        self.add(image, &wanted, pad, looks, colour);
    }

    fn survey(&mut self, image: &Image, states: &[State], gazes: &[Gaze], looks: Looks<'_>) -> Wanted {
        self.size = image.size();
        looks.survey(self.size, states, gazes, &mut self.regions)
    }

    fn add(
        &mut self,
        image: &Image,
        wanted: &Wanted,
        pad: (usize, usize),
        looks: Looks<'_>,
        mut colour: Option<&mut Colour>,
    ) {
        let Self { regions, views, used, size, read } = self;
        for region in &*regions {
            if *used == views.len() {
                views.push(View::default());
            }
            let view = &mut views[*used];
            *used += 1;
            view.region = region.padded(pad, *size);
            view.pyramid.build(image, view.region, looks.footprints, wanted.unit);
            read.add(view.pyramid.used());
            if let Some(colour) = &mut colour {
                colour.sum_up(image, view.region.grown(wanted.margin, *size), wanted.step, &mut view.sums);
                read.add(view.sums.read());
            }
        }
    }

    /// One rectangle with all that looks at these states need, without colours; `None` if there is no such.
    pub(super) fn whole(&mut self, states: &[State], looks: Looks<'_>) -> Option<&View> {
        let wanted = looks.survey(self.size, states, &[Gaze::CENTRE], &mut self.regions);
        let region = self.regions.iter().copied().reduce(|a, b| a.union(&b))?;
        self.views[..self.used].iter().find(|view| view.pyramid.holds(region, looks.footprints, wanted.unit))
    }

    /// Counts the values read of pictures since the last call.
    pub(super) fn measure(&mut self, meter: &mut Meter) {
        meter.add_all(&self.read);
        self.read.clear();
    }

    /// How many rectangles there are.
    pub(super) fn count(&self) -> usize {
        self.used
    }

    /// The k-th rectangle. Panics before anything was seen.
    pub(super) fn get(&self, k: usize) -> &View {
        &self.views[k]
    }

    /// The newest rectangle that contains a state.
    pub(super) fn of(&self, state: &State, gaze: Gaze, looks: Looks<'_>, colours: bool) -> usize {
        if self.used == 1 {
            return 0;
        }
        let reach = Region::reach(state, &[gaze], state.half(looks.extent), looks.reach);
        let (window, ring) = (Region::around(self.size, state, reach), looks.ring(self.size, state));
        let has = |view: &View| view.region.contains(&window) && (!colours || view.sums.covers(ring));
        (0..self.used).rev().find(|k| has(&self.views[*k])).unwrap_or(0)
    }
}
