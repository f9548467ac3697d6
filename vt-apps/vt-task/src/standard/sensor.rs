//! Sensors.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::error::ConfigError;
use vt_io::images::{self, Conversion, Files, ImageSequence, Times};
use vt_io::video::{Settings, Video};

use crate::language::{FilePath, Picture};
use crate::quantity::Rate;
use crate::registry::Params;
use crate::roles::{SensorContext, SensorProduct};

/// Order in which pictures are played.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Order {
    /// First to last.
    #[default]
    Forward,
    /// First to last and back to the first.
    PingPong,
}

/// Parameters of the sensor `images`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Images {
    /// Path with one `%d` or `%0Nd`; either this or `folder`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pattern: Option<FilePath>,
    /// Folder whose pictures are played in natural order.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub folder: Option<FilePath>,
    /// First number of the pattern.
    #[serde(default)]
    pub first: u64,
    /// Last number of the pattern; without it, up to the first that is missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub last: Option<u64>,
    /// Distance of numbers.
    #[serde(default = "one")]
    pub step: u64,
    /// Order of play.
    #[serde(default)]
    pub order: Order,
    /// Frames per second; either this or `timestamps`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Rate>,
    /// File with times, `seconds` or `frame seconds` a line.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub timestamps: Option<FilePath>,
}

fn one() -> u64 {
    1
}

impl Params for Images {
    fn check(&self) -> Result<(), ConfigError> {
        if self.pattern.is_some() == self.folder.is_some() {
            let found = if self.folder.is_some() { "beside `folder`" } else { "missing" };
            return Err(ConfigError::parameter("pattern", found, "either `pattern` or `folder`"));
        }
        if let Some(p) = self.pattern.as_ref().filter(|p| !p.0.contains('%')) {
            return Err(ConfigError::parameter(
                "pattern",
                format!("\"{}\"", p.0),
                "a path with one `%d` or `%0Nd`",
            ));
        }
        if self.rate.is_some() == self.timestamps.is_some() {
            let found = if self.rate.is_some() { "beside `timestamps`" } else { "missing" };
            return Err(ConfigError::parameter("rate", found, "either `rate` or `timestamps`"));
        }
        check_rate(self.rate)?;
        if self.step == 0 {
            return Err(ConfigError::parameter("step", 0, "a step from 1"));
        }
        match self.last.filter(|&l| l < self.first) {
            Some(last) => {
                Err(ConfigError::parameter("last", last, format!("a number from {} (`first`)", self.first)))
            }
            None => Ok(()),
        }
    }

    fn files(&self) -> Vec<(String, FilePath)> {
        let folder = self.folder.iter().map(|f| ("folder".to_owned(), f.clone()));
        let times = self.timestamps.iter().map(|f| ("timestamps".to_owned(), f.clone()));
        // Of a pattern, the folder must be there.
        let pattern = self.pattern.iter().map(|p| {
            let folder = p.0.rsplit_once(['/', '\\']).map_or(".", |(folder, _)| folder);
            ("pattern".to_owned(), FilePath(folder.to_owned()))
        });
        folder.chain(times).chain(pattern).collect()
    }
}

/// Parameters of the sensor `video`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VideoParams {
    /// Video file, of any format that the program `ffmpeg` reads.
    pub file: FilePath,
    /// Frames per second; without it the times that the file says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate: Option<Rate>,
    /// Number of the first frame; those of a file count from 0.
    #[serde(default)]
    pub start: u64,
    /// Number of frames at most.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frames: Option<u64>,
}

impl Params for VideoParams {
    fn check(&self) -> Result<(), ConfigError> {
        check_rate(self.rate)?;
        match self.frames {
            Some(0) => Err(ConfigError::parameter("frames", 0, "at least 1 frame")),
            _ => Ok(()),
        }
    }

    fn files(&self) -> Vec<(String, FilePath)> {
        vec![("file".into(), self.file.clone())]
    }
}

/// Builds the sensor `video`.
pub(super) fn video(p: VideoParams, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let settings = Settings {
        rate: p.rate.map(|r| r.si()),
        start: p.start,
        frames: p.frames,
        conversion: conversion(context.section.picture),
        size: context.section.camera.as_ref().map(|c| c.size),
        ..Settings::default()
    };
    let sensor = Video::open(context.id, &context.place.resolve(&p.file), settings)
        .map_err(|e| ConfigError::Mismatch { found: e.to_string(), expected: "a readable video".into() })?;
    Ok(SensorProduct { sensor: Box::new(sensor), truth: None })
}

pub(super) fn conversion(picture: Picture) -> Conversion {
    match picture {
        Picture::Grey => Conversion::Grey,
        Picture::Colour => Conversion::Rgb,
    }
}

pub(super) fn check_rate(rate: Option<Rate>) -> Result<(), ConfigError> {
    match rate.filter(|r| !(1e-6..=1e6).contains(&r.si())) {
        Some(rate) => Err(ConfigError::parameter("rate", rate, "a positive rate from 1e-6 Hz to 1 MHz")),
        None => Ok(()),
    }
}

/// Builds the sensor `images`.
pub(super) fn images(p: Images, context: SensorContext<'_>) -> Result<SensorProduct, ConfigError> {
    let files = match (&p.pattern, &p.folder) {
        (Some(pattern), _) => Files::Pattern {
            pattern: context.place.resolve(pattern),
            first: p.first,
            last: p.last,
            step: p.step,
        },
        (None, folder) => Files::Folder(context.place.resolve(&folder.clone().unwrap_or_default())),
    };
    let times = match (&p.timestamps, p.rate) {
        (Some(file), _) => Times::File(context.place.resolve(file)),
        (None, rate) => Times::Rate(rate.map_or(1.0, |r| r.si())),
    };
    let order = match p.order {
        Order::Forward => images::Order::Forward,
        Order::PingPong => images::Order::PingPong,
    };
    let conversion = conversion(context.section.picture);
    let size = context.section.camera.as_ref().map(|c| c.size);
    let sensor = ImageSequence::open(context.id, &files, order, &times, conversion, size)
        .map_err(|e| ConfigError::Mismatch { found: e.to_string(), expected: "readable pictures".into() })?;
    Ok(SensorProduct { sensor: Box::new(sensor), truth: None })
}
