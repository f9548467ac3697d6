use super::projection::Span;
use super::{EdgeSite, quarter_turn};
use nalgebra::{Point2, Vector2};

/// Largest angle between nearly parallel edges, as a sine (about 12°).
const PARALLEL: f64 = 0.2;

/// Distance within which an edge in another direction disturbs the profile of a search, pixels: half the length of
/// a derivative's mask. It concerns the sites next to a corner, and those of an edge that leaves the corner behind a
/// surface and is not yet hidden by more than the bias of the depth.
const CROSSING: f64 = 2.5;

/// Marks sites closer than `distance` pixels to another nearly parallel visible edge, or very close to any other;
/// `ideal` are their ideal pixels.
pub(super) fn mark(
    sites: &mut [EdgeSite],
    ideal: &[Point2<f64>],
    spans: &[Span],
    order: &mut Vec<u32>,
    distance: f64,
) {
    let other_end = |s: &Span| s.start + s.direction * s.length;
    let low = |s: &Span| s.start.x.min(other_end(s).x);
    let high = |s: &Span| s.start.x.max(other_end(s).x);
    order.clear();
    order.extend(0..spans.len() as u32);
    order.sort_unstable_by(|&i, &j| {
        low(&spans[i as usize]).total_cmp(&low(&spans[j as usize])).then(i.cmp(&j))
    });
    for (k, &i) in order.iter().enumerate() {
        let a = &spans[i as usize];
        for &j in &order[k + 1..] {
            let b = &spans[j as usize];
            if low(b) > high(a) + distance {
                break;
            }
            let parallel = a.direction.perp(&b.direction).abs() < PARALLEL;
            let limit = if parallel { distance } else { distance.min(CROSSING) };
            mark_one(sites, ideal, a, b, limit);
            mark_one(sites, ideal, b, a, limit);
        }
    }
}

/// Marks sites of one span that lie beside the part of the other that has sites.
fn mark_one(sites: &mut [EdgeSite], ideal: &[Point2<f64>], span: &Span, other: &Span, distance: f64) {
    let across: Vector2<f64> = quarter_turn(&other.direction);
    let along = |k: u32| (ideal[k as usize] - other.start).dot(&other.direction);
    let half = 0.5 * f64::from(sites[other.first as usize].weight);
    let (low, high) = (along(other.first) - half, along(other.end - 1) + half);
    let range = span.first as usize..span.end as usize;
    for (site, q) in sites[range.clone()].iter_mut().zip(&ideal[range]) {
        let d = q - other.start;
        let along = d.dot(&other.direction);
        site.ambiguous |= d.dot(&across).abs() < distance && along >= low && along <= high;
    }
}
