//! The arguments of `foveate track` for many targets.

use std::ffi::OsStr;
use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use foveate::config::DetectorConfig;
use foveate::scene::object_detector::{Layout, Settings};
use foveate::{Error, Result};

use super::source::named;

/// Arguments that select many targets.
#[derive(clap::Args)]
pub(super) struct ManyArgs {
    /// Follow all objects that a detector finds, without a given box: tracks are started, terminated, and re-identified when their targets
    /// return. Default KIND: motion (the camera must stand still); onnx:MODEL runs a network from an ONNX file, such as YOLO's. Replaces
    /// the configuration's detector
    #[arg(long, value_parser = Detectors, value_name = "KIND", num_args = 0..=1, default_missing_value = "motion", conflicts_with = "detections")]
    pub detect: Option<DetectorConfig>,
    /// Follow the detections of another detector: MOTChallenge's text (frame,id,x,y,w,h,conf,...; counted from 1; ids are ignored).
    /// Replaces the configuration's detector
    #[arg(long, value_name = "FILE")]
    pub detections: Option<PathBuf>,
    /// Minimum confidence of a line of --detections (default: 0) or a box of --detect onnx:MODEL (default: 0.25)
    #[arg(long, value_name = "CONF", allow_hyphen_values = true, value_parser = parse_confidence)]
    pub least: Option<f64>,
    /// Classes of --detect onnx:MODEL to use, by number from 0; default: all
    #[arg(long, value_name = "N,N", value_delimiter = ',')]
    pub classes: Vec<usize>,
    /// Output layout of --detect onnx:MODEL; default: inferred from its dimensions
    #[arg(long, value_name = "NAME", value_parser = named(LAYOUTS))]
    pub layout: Option<Layout>,
    /// First boxes of many targets: one line frame,id,x,y,w,h each, counted from 1, as in MOTChallenge's text
    #[arg(long, value_name = "FILE")]
    pub inits: Option<PathBuf>,
    /// Write the detections in MOTChallenge's text, for --detections or other trackers
    #[arg(long, value_name = "FILE")]
    pub save_detections: Option<PathBuf>,
}

fn parse_confidence(text: &str) -> std::result::Result<f64, String> {
    let number = text.parse().ok().filter(|number: &f64| number.is_finite());
    number.ok_or_else(|| format!("expected a number such as 0.5, got \"{text}\""))
}

/// The layouts by name.
const LAYOUTS: [(&str, Layout); 4] =
    [("auto", Layout::Auto), ("yolov8", Layout::Yolov8), ("yolov5", Layout::Yolov5), ("end-to-end", Layout::EndToEnd)];

/// Parses a detector: its name, or `onnx:` and a file.
#[derive(Clone)]
struct Detectors;

impl Detectors {
    fn names() -> impl Iterator<Item = &'static str> {
        DetectorConfig::ALL.into_iter().map(|(name, _)| name).chain(["onnx:MODEL"])
    }
}

impl TypedValueParser for Detectors {
    type Value = DetectorConfig;

    fn parse_ref(
        &self,
        command: &clap::Command,
        argument: Option<&clap::Arg>,
        value: &OsStr,
    ) -> std::result::Result<Self::Value, clap::Error> {
        if let Some(model) =
            value.to_str().and_then(|value| value.strip_prefix("onnx:")).filter(|model| !model.is_empty())
        {
            return Ok(DetectorConfig::Onnx(Settings::of(model)));
        }
        let name = PossibleValuesParser::new(Self::names()).parse_ref(command, argument, value)?;
        let known = DetectorConfig::ALL.into_iter().find(|(known, _)| *known == name);
        // `onnx:MODEL` always means a file of that name.
        Ok(known.map_or_else(|| DetectorConfig::Onnx(Settings::of("MODEL")), |(_, config)| config))
    }

    fn possible_values(&self) -> Option<Box<dyn Iterator<Item = PossibleValue> + '_>> {
        Some(Box::new(Self::names().map(PossibleValue::new)))
    }
}

impl ManyArgs {
    /// Returns the shipped configuration for motion detection, other detections, or first boxes alone.
    pub(super) fn config(&self) -> &'static str {
        match self.detect {
            Some(DetectorConfig::Motion | DetectorConfig::Walkers | DetectorConfig::Flow) => "multi-motion",
            None if self.detections.is_none() => "multi-boxes",
            _ => "multi",
        }
    }

    /// Returns the program's detector with its options.
    ///
    /// # Errors
    /// An option does not apply to this detector, or to a file of detections.
    pub(super) fn detector(&self) -> Result<Option<DetectorConfig>> {
        let network = matches!(self.detect, Some(DetectorConfig::Onnx(_)));
        for (given, name, applies, of) in [
            (
                self.least.is_some(),
                "--least",
                network || self.detections.is_some(),
                "--detections FILE or --detect onnx:MODEL",
            ),
            (!self.classes.is_empty(), "--classes", network, "--detect onnx:MODEL"),
            (self.layout.is_some(), "--layout", network, "--detect onnx:MODEL"),
        ] {
            if given && !applies {
                return Err(Error::Invalid(format!("{name} is for {of}; give that too, or leave it out")));
            }
        }
        let mut detector = self.detect.clone();
        if let Some(DetectorConfig::Onnx(settings)) = &mut detector {
            settings.confidence = self.least.unwrap_or(settings.confidence);
            settings.classes.clone_from(&self.classes);
            settings.layout = self.layout.unwrap_or(settings.layout);
        }
        Ok(detector)
    }

    /// Returns whether the arguments, apart from several --init, select many targets.
    pub(super) fn asked(&self) -> bool {
        // Detector options are refused later if there is no detector.
        let has_options = self.least.is_some() || !self.classes.is_empty() || self.layout.is_some();
        let files = self.detections.is_some() || self.inits.is_some() || self.save_detections.is_some();
        self.detect.is_some() || files || has_options
    }
}
