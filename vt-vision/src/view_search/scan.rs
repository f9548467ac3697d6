//! Coarse search: all views, turned about the line of sight, at all places of a picture in which the object has a fixed
//! size.

use rayon::prelude::*;
use vt_core::math;

use super::orientation_map::{BINS, BLOCK, EMPTY, FULL, FULL_EMPTY, OrientationMap, bin};
use super::views::{View, half_turn};

/// Least size of the bounding sphere in the searched picture, pixels.
pub const SIZE: f64 = 32.0;

/// Size of the bounding sphere in the searched picture, pixels, for an object of this size in the whole picture: large
/// ones need finer templates, since the shapes around them are smaller than they are.
pub fn searched_size(size: f64) -> f64 {
    (0.4 * size).clamp(SIZE, 64.0)
}

/// Contour points that are compared.
const POINTS: usize = 36;

/// Points inside the contour at which there should be no edge; with those of the contour the sums fit a byte.
pub const INSIDE: usize = 16;
const _: () = assert!(POINTS * FULL as usize + INSIDE * FULL_EMPTY as usize <= u8::MAX as usize);

/// Points after which places that fall behind are given up.
const FIRST: usize = 14;

/// Share of the full answer that the first points must have.
const FIRST_LEAST: f64 = 0.35;

/// Turns about the line of sight.
pub const ROLLS: usize = 24;

/// Share of the full answer below which nothing is a candidate.
const LEAST: f64 = 0.4;

/// Best places kept of each turned view.
const PLACES: usize = 2;

/// A view found somewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Share of the full answer, 0 to 1.
    pub score: f64,
    /// Index of the view.
    pub view: usize,
    /// Turn about the line of sight, radians.
    pub roll: f64,
    /// Place of the centre in the searched picture, pixels.
    pub at: [f64; 2],
}

/// Sums at `BLOCK` positions that exceed the weakest kept place of this template.
fn keep(
    places: &mut [(u8, usize); PLACES],
    least: &mut u8,
    sums: &[u8; BLOCK],
    first: usize,
    map: &OrientationMap,
) {
    for (k, &sum) in sums.iter().enumerate() {
        if sum <= *least || map.pixel(first + k).is_none() {
            continue;
        }
        // Neighbours share a place.
        let near = |p: usize| map.near(p, first + k);
        match places.iter().position(|(s, p)| *s > 0 && near(*p)) {
            Some(same) => {
                if sum > places[same].0 {
                    places[same] = (sum, first + k);
                }
            }
            None => places[PLACES - 1] = (sum, first + k),
        }
        places.sort_by_key(|(s, p)| (core::cmp::Reverse(*s), *p));
        *least = (*least).max(places[PLACES - 1].0);
    }
}

/// The best places of `view` at all turns.
fn places_of(index: usize, view: &View, map: &OrientationMap, size: f64) -> Vec<Hit> {
    let points = &view.points[..view.points.len().min(POINTS)];
    let full = points.len() as f64 * f64::from(FULL);
    let mut starts = Vec::with_capacity(points.len());
    let mut hits = vec![];
    for turn in 0..ROLLS {
        let roll = turn as f64 * core::f64::consts::TAU / ROLLS as f64;
        let (s, c) = math::sin_cos(roll);
        starts.clear();
        let start = |at: [f32; 2], plane: usize| {
            let [x, y] = at.map(f64::from);
            // A template reaches this many pixels from its centre at most.
            let pixel = |v: f64| (v * size).clamp(-size, size).round() as i32;
            map.start(plane, pixel(c * x - s * y), pixel(s * x + c * y))
        };
        starts.extend(points.iter().map(|p| {
            let angle = half_turn(f64::from(p.angle) + roll);
            start(p.at, bin(angle, BINS))
        }));
        starts.extend(view.inside.iter().map(|&at| start(at, EMPTY)));
        let mut places = [(0, 0); PLACES];
        let mut least = (LEAST * full) as u8;
        let few_least = (FIRST_LEAST * points.len().min(FIRST) as f64 * f64::from(FULL)) as u8;
        for first in (0..map.positions()).step_by(BLOCK) {
            let mut sums = [0; BLOCK];
            let (few, rest) = starts.split_at(points.len().min(FIRST));
            map.sum(few, first, &mut sums);
            if sums.iter().fold(0, |m, &s| m.max(s)) < few_least {
                continue;
            }
            map.sum(rest, first, &mut sums);
            if sums.iter().fold(0, |m, &s| m.max(s)) > least {
                keep(&mut places, &mut least, &sums, first, map);
            }
        }
        hits.extend(places.iter().filter(|(s, _)| *s > 0).filter_map(|&(sum, position)| {
            Some(Hit { score: f64::from(sum) / full, view: index, roll, at: map.pixel(position)? })
        }));
    }
    hits
}

/// The `most` best hits, best first, of which no two are the same: near each other with nearly the same rotation.
/// `size` is that of the bounding sphere in the searched picture, pixels.
pub fn scan(views: &[View], map: &OrientationMap, size: f64, most: usize) -> Vec<Hit> {
    let mut hits: Vec<Hit> =
        views.par_iter().enumerate().flat_map_iter(|(k, view)| places_of(k, view, map, size)).collect();
    hits.sort_by(|a, b| {
        b.score
            .total_cmp(&a.score)
            .then(a.view.cmp(&b.view))
            .then(a.roll.total_cmp(&b.roll))
            .then(a.at[1].total_cmp(&b.at[1]).then(a.at[0].total_cmp(&b.at[0])))
    });
    let rotation = |h: &Hit| {
        nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::z() * h.roll) * views[h.view].rotation
    };
    let mut kept: Vec<(Hit, nalgebra::UnitQuaternion<f64>)> = vec![];
    let mut crowd = std::collections::BTreeMap::new();
    for hit in hits {
        let here = crowd.entry(hit.at.map(|c| (c / PLACE) as i32)).or_insert(0);
        if *here >= CROWD {
            continue;
        }

        if kept.len() >= most {
            break;
        }
        let turned = rotation(&hit);
        let same = |(other, q): &(Hit, nalgebra::UnitQuaternion<f64>)| {
            let near = (0..2).all(|k| (other.at[k] - hit.at[k]).abs() < SAME_PLACE);
            near && q.coords.dot(&turned.coords).abs() > SAME_ROTATION
        };
        if !kept.iter().any(same) {
            kept.push((hit, turned));
            *here += 1;
        }
    }
    kept.into_iter().map(|(hit, _)| hit).collect()
}

/// Distance in each coordinate up to which two hits are the same, pixels.
const SAME_PLACE: f64 = 4.5;

/// Cosine of half the angle up to which two hits are the same: 12°.
const SAME_ROTATION: f64 = 0.994_5;

/// Side of the cells in each of which at most [`CROWD`] hits are kept, pixels.
const PLACE: f64 = 8.0;

/// Most hits of a cell; otherwise the views of one simple shape in the background crowd all others out.
const CROWD: usize = 30;
