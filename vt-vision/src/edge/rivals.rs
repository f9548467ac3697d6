//! Image edges that two contours claim.
//!
//! Two nearly parallel contours that lie close together (the two ends of a narrow side face) may be matched to one and
//! the same image edge; at most one of them is right, and both together hold the pose where it is wrong.

use nalgebra::{DefaultAllocator, Point2, Point3};
use vt_core::agent::Posed;
use vt_core::manifold::{Alloc, Manifold};

use super::features::EdgeRow;

/// Two matches are of one image edge when they are this close along the normal, pixels.
const ACROSS: f64 = 1.0;

/// … and this close along the contour, pixels.
const ALONG: f64 = 6.0;

/// Sine of the largest angle between normals of one image edge.
const PARALLEL: f64 = 0.2;

/// A match counts when it is at least this probable.
const MATCHED: f64 = 0.1;

/// Buffers of the test.
#[derive(Clone, Debug)]
pub(super) struct Rivals {
    matches: Vec<(Point2<f64>, u32)>,
    contested: Vec<bool>,
}

impl Rivals {
    pub fn with_capacity(lines: usize) -> Self {
        Self { matches: Vec::with_capacity(lines), contested: Vec::with_capacity(lines) }
    }

    /// Takes out of `rows` all that share an image edge with a row of another model edge, unless fewer than a quarter
    /// would remain.
    pub fn leave_out<P: Manifold>(
        &mut self,
        posed: &impl Posed<P, Body = Point3<f64>>,
        rows: &mut Vec<EdgeRow>,
    ) where
        DefaultAllocator: Alloc<P::D>,
    {
        let Self { matches, contested } = self;
        matches.clear();
        for (i, row) in rows.iter().enumerate().filter(|(_, row)| row.weight > MATCHED) {
            if let Some(y) = posed.locate(&row.point) {
                let found = y + row.normal * (row.position - row.normal.dot(&y.coords));
                matches.push((found, i as u32));
            }
        }
        matches.sort_unstable_by(|a, b| a.0.x.total_cmp(&b.0.x).then(a.1.cmp(&b.1)));
        contested.clear();
        contested.resize(rows.len(), false);
        for (k, (p, i)) in matches.iter().enumerate() {
            let one = &rows[*i as usize];
            for (q, j) in matches[k + 1..].iter().take_while(|(q, _)| q.x - p.x < ACROSS + ALONG) {
                let other = &rows[*j as usize];
                let d = q - p;
                if one.edge != other.edge
                    && one.normal.perp(&other.normal).abs() < PARALLEL
                    && d.dot(&one.normal).abs() < ACROSS
                    && d.perp(&one.normal).abs() < ALONG
                {
                    contested[*i as usize] = true;
                    contested[*j as usize] = true;
                }
            }
        }
        let clear = contested.iter().filter(|c| !**c).count();
        if 4 * clear >= rows.len() {
            let mut k = 0;
            rows.retain(|_| {
                k += 1;
                !contested[k - 1]
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix2, Vector2};
    use vt_core::lie::Vector;

    /// Points whose first two coordinates are pixels, moved by a translation.
    struct Flat(Vector2<f64>);

    impl Posed<Vector<2>> for Flat {
        type Body = Point3<f64>;
        fn locate(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
            Some(point.xy() + self.0)
        }
        fn linearize(&self, point: &Point3<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
            Some((point.xy() + self.0, Matrix2::identity()))
        }
    }

    /// Ten lines of a vertical contour at `contour` matched to an image edge at `found`.
    fn upright(edge: u32, contour: f64, found: f64) -> impl Iterator<Item = EdgeRow> {
        (0..10).map(move |k| EdgeRow {
            edge,
            point: Point3::new(contour, 10.0 * f64::from(k), 0.0),
            normal: Vector2::x(),
            position: found,
            variance: 1.0,
            weight: 0.9,
        })
    }

    fn left(rows: impl Iterator<Item = EdgeRow>) -> Vec<u32> {
        let mut rows: Vec<_> = rows.collect();
        Rivals::with_capacity(0).leave_out::<Vector<2>>(&Flat(Vector2::zeros()), &mut rows);
        let mut edges: Vec<u32> = rows.iter().map(|row| row.edge).collect();
        edges.dedup();
        edges
    }

    #[test]
    fn two_contours_on_one_image_edge_are_left_out() {
        assert_eq!(
            left(upright(0, 50.0, 52.0).chain(upright(1, 54.0, 52.3)).chain(upright(2, 90.0, 90.0))),
            [2]
        );
    }

    #[test]
    fn contours_with_edges_of_their_own_stay() {
        assert_eq!(left(upright(0, 50.0, 50.2).chain(upright(1, 54.0, 54.1))), [0, 1]);
        let crossing = (0..10).map(|k| EdgeRow {
            edge: 1,
            point: Point3::new(10.0 * f64::from(k), 50.0, 0.0),
            normal: Vector2::y(),
            position: 50.0,
            variance: 1.0,
            weight: 0.9,
        });
        assert_eq!(left(upright(0, 50.0, 50.0).chain(crossing)), [0, 1]);
    }

    #[test]
    fn what_would_leave_too_little_is_kept() {
        assert_eq!(left(upright(0, 50.0, 52.0).chain(upright(1, 54.0, 52.0))), [0, 1]);
    }
}
