//! Polygons drawn with the share of each pixel that they cover.

use nalgebra::Point2;

use crate::texture::Colour;

/// Lines in a row of pixels; along a line coverage is exact.
const LINES: usize = 8;

/// Draws polygons; what it works with is kept from one to the next.
#[derive(Default)]
pub(super) struct Brush {
    /// Covered share of each pixel of a row; zeros between rows.
    shares: Vec<f32>,
    crossings: Vec<f64>,
}

impl Brush {
    /// Calls `paint` with column, row and covered share of every pixel inside closed polygons (an even number of them
    /// around a point is outside), row by row.
    pub fn fill<L: AsRef<[Point2<f64>]>>(
        &mut self,
        loops: &[L],
        [w, h]: [usize; 2],
        mut paint: impl FnMut(usize, usize, f32),
    ) {
        let ys = || loops.iter().flat_map(|points| points.as_ref()).map(|p| p.y);
        let top = (ys().fold(f64::INFINITY, f64::min) + 0.5).floor().max(0.0);
        let bottom = (ys().fold(f64::NEG_INFINITY, f64::max) + 0.5).floor().min(h as f64 - 1.0);
        if top > bottom {
            return;
        }
        let Self { shares, crossings } = self;
        shares.resize(w, 0.0);
        for y in top as usize..=bottom as usize {
            let mut touched = [w, 0];
            for line in 0..LINES {
                let at = y as f64 - 0.5 + (line as f64 + 0.5) / LINES as f64;
                crossings.clear();
                for points in loops.iter().map(L::as_ref) {
                    let sides = points.iter().zip(points.iter().cycle().skip(1));
                    for (a, b) in sides.filter(|(a, b)| (a.y > at) != (b.y > at)) {
                        // From the left border of pixel 0.
                        crossings.push(a.x + (at - a.y) / (b.y - a.y) * (b.x - a.x) + 0.5);
                    }
                }
                crossings.sort_by(f64::total_cmp);
                for span in crossings.chunks_exact(2) {
                    let (from, to) = (span[0].clamp(0.0, w as f64), span[1].clamp(0.0, w as f64));
                    let last = (to.ceil() as usize).min(w);
                    for (k, share) in shares.iter_mut().enumerate().take(last).skip(from as usize) {
                        let covered = to.min(k as f64 + 1.0) - from.max(k as f64);
                        *share += (covered / LINES as f64) as f32;
                    }
                    touched = [touched[0].min(from as usize), touched[1].max(last)];
                }
            }
            for (x, share) in shares.iter_mut().enumerate().take(touched[1]).skip(touched[0]) {
                if *share > 0.0 {
                    paint(x, y, share.min(1.0));
                }
                *share = 0.0;
            }
        }
    }
}

/// `under` where `over` covers this share of it.
pub(super) fn blend(under: &mut Colour, over: &Colour, share: f32) {
    under.iter_mut().zip(over).for_each(|(u, o)| *u += share * (o - *u));
}
