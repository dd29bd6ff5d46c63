//! The detector that runs a network on pictures.

use std::sync::Arc;

use super::Settings;
use super::boxes::{Reading, suppress};
use super::letterbox::Letterbox;
use crate::geometry::Size;
use crate::onnx::{Graph, Network, fixed, shape};
use crate::scene::{Detection, Detector, Image, Map};
use foveate_base::{Error, Result};

/// Side of a cell of the map, pixels.
const CELL: usize = 8;

/// A network that finds objects. Clones share it.
#[derive(Clone)]
pub struct ObjectDetector {
    network: Arc<Network>,
    settings: Settings,
    reading: Reading,
    /// Planes, height and width of the input.
    planes: usize,
    height: usize,
    width: usize,
    input: Vec<f32>,
    output: Vec<f32>,
    map: Map,
}

foveate_base::opaque_debug!(ObjectDetector);

impl ObjectDetector {
    /// # Errors
    /// Fails if the network does not take one picture, gives no boxes, has no such class, cannot be run, or takes too much memory.
    pub(crate) fn new(graph: &Graph, settings: &Settings) -> Result<Self> {
        settings.check()?;
        let found = graph.sides();
        let planes = match *found {
            [None | Some(1), planes @ (None | Some(1 | 3)), _, _] => planes.unwrap_or(3),
            _ => {
                let found = shape(found);
                return Err(graph.error(format!(
                    "its input is {found}, expected (1, 3, height, width) or one plane of grey; export a detector for one picture"
                )));
            }
        };
        let (height, width) = (found[2].unwrap_or(settings.side), found[3].unwrap_or(settings.side));
        let network = graph.network(&[1, planes, height, width])?;
        let sides = network.output().to_vec();
        let reading = Reading::new(settings.layout, &sides).map_err(|expected| {
            let found = fixed(&sides);
            graph.error(format!("its output is {found}, no known layout of boxes: {expected}"))
        })?;
        if let Some((classes, class)) =
            reading.classes().and_then(|n| settings.classes.iter().find(|class| **class >= n).map(|class| (n, class)))
        {
            let model = &settings.model;
            return Err(Error::Config(format!(
                "detector.classes has {class}, but {model} has {classes} classes, 0 to {}",
                classes - 1
            )));
        }
        let (input, output) = (vec![0.0; planes * height * width], vec![0.0; sides.iter().product()]);
        let map = Map::default();
        let mut made = Self {
            network: Arc::new(network),
            settings: settings.clone(),
            reading,
            planes,
            height,
            width,
            input,
            output,
            map,
        };
        // Some networks fail only when they run.
        made.network.run(&made.input, &mut made.output)?;
        if made.output.iter().any(|x| x.is_nan()) {
            return Err(graph.error("its output for a black picture is not a number (NaN); check its weights"));
        }
        Ok(made)
    }
}

impl Detector for ObjectDetector {
    /// A picture on which the network fails after all holds nothing.
    fn detect(&mut self, image: &Image, found: &mut Vec<Detection>) {
        found.clear();
        self.map.cover(image.width(), image.height(), CELL);
        let letterbox = Letterbox::new(image.size(), Size::new(self.width, self.height));
        let grey = (self.planes == 1 && image.planes() > 1).then(|| image.to_grey());
        let mut planes: Vec<&mut [f32]> = self.input.chunks_exact_mut(self.width * self.height).collect();
        letterbox.fill(grey.as_ref().unwrap_or(image), self.width, &mut planes);
        if self.network.run(&self.input, &mut self.output).is_err() {
            return;
        }
        let classes = &self.settings.classes;
        self.reading.each(&self.output, self.settings.confidence, |corners, score, class| {
            if classes.is_empty() || classes.contains(&class) {
                found.extend(
                    letterbox.back(corners).map(|bbox| Detection { class: Some(class), ..Detection::new(bbox, score) }),
                );
            }
        });
        suppress(found, self.settings.overlap, self.settings.most);
        let columns = self.map.width();
        let cells = |from: f64, length: f64| from as usize / CELL..((from + length) as usize).div_ceil(CELL);
        for Detection { bbox, score, .. } in found.iter() {
            let (across, down) = (cells(bbox.x, bbox.w), cells(bbox.y, bbox.h));
            for row in self.map.values_mut().chunks_exact_mut(columns).take(down.end).skip(down.start) {
                row[across.start..across.end.min(columns)].iter_mut().for_each(|cell| *cell = cell.max(*score as f32));
            }
        }
    }

    fn map(&self) -> &Map {
        &self.map
    }
}
