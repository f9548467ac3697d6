//! Targets with true boxes: those that are judged, and others on which parameters are chosen.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use vt_core::metrics::Rectangle;

/// A target with its true boxes, frame by frame from its first.
pub struct Track {
    pub name: String,
    /// Settings of its sensor, which starts with its first frame.
    pub sensor: Vec<String>,
    pub boxes: Vec<Option<Rectangle>>,
}

/// Identities of PETS that are judged: those that are seen longest.
const JUDGED: usize = 3;

/// As many of the next longest are developed on.
const DEVELOPED: usize = 10;

/// Share of a box that others may cover where a target starts.
const COVERED: f64 = 0.05;

/// A true box of a frame, counted from 1.
type Seen = (usize, Rectangle);

/// The judged targets: Crossing and three of PETS.
pub fn judged(data: &Path) -> Result<Vec<Track>> {
    let all = identities(data)?;
    let longest = all.iter().take(JUDGED).filter_map(|i| pets(data, i, i.1.first()?.0));
    Ok(core::iter::once(crossing(data)?).chain(longest).collect())
}

/// Other targets, none of which is judged, each from `starts` frames of its life in which nobody covers it.
pub fn development(data: &Path, starts: usize) -> Result<Vec<Track>> {
    let all = identities(data)?;
    let tracks = all.iter().skip(JUDGED).take(DEVELOPED);
    let tracks = tracks.flat_map(|i| (0..starts).map(move |k| (i, i.1.len() * k / starts)));
    Ok(tracks.filter_map(|(i, from)| pets(data, i, free(&all, i, from)?)).collect())
}

/// The first frame of an identity, from its box with this index on, in which nobody covers it.
fn free(all: &[(u64, Vec<Seen>)], (identity, boxes): &(u64, Vec<Seen>), from: usize) -> Option<usize> {
    let alone = |(frame, own): &&Seen| {
        let others = all.iter().filter(|(other, _)| other != identity);
        others.flat_map(|(_, b)| b).filter(|(f, _)| f == frame).all(|(_, b)| shared(own, b) <= COVERED)
    };
    boxes.get(from..)?.iter().find(alone).map(|(frame, _)| *frame)
}

/// Fields of a line of numbers.
fn fields(line: &str) -> Vec<f64> {
    line.split([',', '\t', ' ']).filter_map(|w| w.trim().parse().ok()).collect()
}

fn crossing(data: &Path) -> Result<Track> {
    let folder = data.join("sot/Crossing");
    let text = std::fs::read_to_string(folder.join("groundtruth.txt"))?;
    let boxes = text.lines().map(|line| match fields(line)[..] {
        // Counted from 1.
        [x, y, width, height] => Some(Rectangle { x: x - 1.0, y: y - 1.0, width, height }),
        _ => None,
    });
    let sensor = vec![format!("sensors.camera.params.folder='{}'", folder.join("img").display())];
    Ok(Track { name: "Crossing".into(), sensor, boxes: boxes.collect() })
}

/// All identities of PETS, that which is seen longest first. Frame `k` of the truth is the `k`-th of the video.
fn identities(data: &Path) -> Result<Vec<(u64, Vec<Seen>)>> {
    let text = std::fs::read_to_string(data.join("mot/PETS09-S2L1/gt.txt"))?;
    let mut all = BTreeMap::<u64, Vec<Seen>>::new();
    for f in text.lines().map(fields).filter(|f| f.len() >= 6) {
        let bounds = Rectangle { x: f[2] - 1.0, y: f[3] - 1.0, width: f[4], height: f[5] };
        all.entry(f[1] as u64).or_default().push((f[0] as usize, bounds));
    }
    let mut longest: Vec<_> = all.into_iter().collect();
    longest.sort_by_key(|(_, boxes)| core::cmp::Reverse(boxes.len()));
    Ok(longest)
}

/// An identity from the frame `first`.
fn pets(data: &Path, (identity, boxes): &(u64, Vec<Seen>), first: usize) -> Option<Track> {
    let mut all = vec![None; boxes.last()?.0 + 1 - first];
    boxes.iter().filter(|b| b.0 >= first).for_each(|&(frame, bounds)| all[frame - first] = Some(bounds));
    let video = data.join("pets/View_001.mp4");
    let params = format!("{{file='{}', rate='7 Hz', start={}}}", video.display(), first - 1);
    let sensor = vec!["sensors.camera.kind='video'".into(), format!("sensors.camera.params={params}")];
    Some(Track { name: format!("PETS {identity} from {first}"), sensor, boxes: all })
}

/// Share of the first box that lies in the other.
fn shared(own: &Rectangle, other: &Rectangle) -> f64 {
    let along = |a: f64, length: f64, b: f64, other: f64| ((a + length).min(b + other) - a.max(b)).max(0.0);
    let common =
        along(own.x, own.width, other.x, other.width) * along(own.y, own.height, other.y, other.height);
    common / (own.width * own.height)
}
