//! Joins sides that overlap or follow one another on a straight line.

use super::sheet::{Judge, Sheet, alike};
use super::{Edge, MeshReport};
use nalgebra::Point3;

/// A side between two welded vertices with everything that leaves it.
pub(super) struct Raw {
    pub ends: [u32; 2],
    pub sheets: Vec<Sheet>,
    pub line: bool,
}

/// Largest bend between sides of one line, as a sine (0.1°); keeps fine polygons from becoming straight.
const BEND: f64 = 1.745e-3;

/// Most pairs of sides whose boxes touch: some ten a side are usual.
const MAX_PAIRS: usize = 20_000_000;

/// Cuts the sides of each straight line at all their ends, judges every interval by all sheets on it, and joins
/// neighbours judged alike. `None` where too many sides lie at one place.
pub(super) fn join(
    raw: &[Raw],
    points: &[Point3<f64>],
    tolerance: f64,
    judge: &Judge,
    report: &mut MeshReport,
) -> Option<Vec<Edge>> {
    let mut edges = Vec::with_capacity(raw.len());
    for group in groups(raw, points, tolerance)? {
        if fits_a_line(&group, raw, points, tolerance) {
            intervals(&group, raw, points, tolerance, judge, &mut edges, report);
        } else {
            for &i in &group {
                intervals(&[i], raw, points, tolerance, judge, &mut edges, report);
            }
        }
    }
    Some(edges)
}

/// Indices of sides that hang together on a line, ordered by their first member; `None` beyond [`MAX_PAIRS`].
fn groups(raw: &[Raw], points: &[Point3<f64>], tolerance: f64) -> Option<Vec<Vec<usize>>> {
    let n = raw.len();
    let end = |i: usize, k: usize| points[raw[i].ends[k] as usize];
    let low: Vec<Point3<f64>> = (0..n).map(|i| end(i, 0).inf(&end(i, 1))).collect();
    let high: Vec<Point3<f64>> = (0..n).map(|i| end(i, 0).sup(&end(i, 1))).collect();
    let Some(first) = low.first() else { return Some(Vec::new()) };
    let (min, max) = low.iter().zip(&high).fold((*first, *first), |(a, b), (l, h)| (a.inf(l), b.sup(h)));
    let axis = (max - min).imax();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| low[i][axis].total_cmp(&low[j][axis]).then(i.cmp(&j)));
    let mut parent: Vec<usize> = (0..n).collect();
    let mut pairs = 0_usize;
    for (k, &i) in order.iter().enumerate() {
        for &j in &order[k + 1..] {
            if low[j][axis] > high[i][axis] + tolerance {
                break;
            }
            let apart =
                (0..3).any(|a| low[j][a] > high[i][a] + tolerance || low[i][a] > high[j][a] + tolerance);
            if apart {
                continue;
            }
            pairs += 1;
            if pairs > MAX_PAIRS {
                return None;
            }
            let (ri, rj) = (root(&mut parent, i), root(&mut parent, j));
            if ri != rj && on_one_line([end(i, 0), end(i, 1)], [end(j, 0), end(j, 1)], tolerance) {
                parent[ri.max(rj)] = ri.min(rj);
            }
        }
    }
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); n];
    for i in 0..n {
        members[root(&mut parent, i)].push(i);
    }
    members.retain(|m| !m.is_empty());
    Some(members)
}

fn root(parent: &mut [usize], mut i: usize) -> usize {
    while parent[i] != i {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    i
}

/// Whether two segments lie on one line and touch or overlap.
fn on_one_line(a: [Point3<f64>; 2], b: [Point3<f64>; 2], tolerance: f64) -> bool {
    let (da, db) = (a[1] - a[0], b[1] - b[0]);
    let (la, lb) = (da.norm(), db.norm());
    if da.cross(&db).norm() > BEND * la * lb {
        return false;
    }
    let (origin, u, length, other) = if la >= lb { (a[0], da / la, la, b) } else { (b[0], db / lb, lb, a) };
    let t = other.map(|p| (p - origin).dot(&u));
    let off = other.iter().zip(t).any(|(p, t)| (p - origin - u * t).norm() > tolerance);
    !off && t[0].max(t[1]) >= -tolerance && t[0].min(t[1]) <= length + tolerance
}

/// The group's farthest ends as seen along its longest side.
fn extent(group: &[usize], raw: &[Raw], points: &[Point3<f64>]) -> [Point3<f64>; 2] {
    let at = |v: u32| points[v as usize];
    let ends = |i: usize| raw[i].ends.map(at);
    let mut longest = ends(group[0]);
    for &i in group {
        let e = ends(i);
        if (e[1] - e[0]).norm_squared() > (longest[1] - longest[0]).norm_squared() {
            longest = e;
        }
    }
    let u = longest[1] - longest[0];
    let mut span = longest;
    for p in group.iter().flat_map(|&i| ends(i)) {
        if (p - span[0]).dot(&u) < 0.0 {
            span[0] = p;
        }
        if (p - span[1]).dot(&u) > 0.0 {
            span[1] = p;
        }
    }
    span
}

fn fits_a_line(group: &[usize], raw: &[Raw], points: &[Point3<f64>], tolerance: f64) -> bool {
    let [p, q] = extent(group, raw, points);
    let u = (q - p).normalize();
    group.iter().flat_map(|&i| raw[i].ends).all(|v| {
        let d = points[v as usize] - p;
        (d - u * d.dot(&u)).norm() <= 2.0 * tolerance
    })
}

fn intervals(
    group: &[usize],
    raw: &[Raw],
    points: &[Point3<f64>],
    tolerance: f64,
    judge: &Judge,
    edges: &mut Vec<Edge>,
    report: &mut MeshReport,
) {
    let [p, q] = extent(group, raw, points);
    let u = (q - p).normalize();
    let along = |v: u32| (points[v as usize] - p).dot(&u);
    let mut stops: Vec<(f64, u32)> = group.iter().flat_map(|&i| raw[i].ends).map(|v| (along(v), v)).collect();
    stops.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    stops.dedup_by(|next, kept| next.0 - kept.0 <= tolerance);
    let stop = |v: u32| {
        let t = along(v);
        // The last stop not after t, within the tolerance by construction.
        stops.partition_point(|s| s.0 <= t).saturating_sub(1)
    };
    let spans: Vec<(usize, usize)> = group
        .iter()
        .map(|&i| {
            let [a, b] = raw[i].ends.map(stop);
            (a.min(b), a.max(b))
        })
        .collect();
    let mut open: Option<Edge> = None;
    for k in 0..stops.len().saturating_sub(1) {
        let here = || group.iter().zip(&spans).filter(|(_, s)| s.0 <= k && k < s.1).map(|(&i, _)| &raw[i]);
        let all: Vec<Sheet> = here().flat_map(|r| r.sheets.iter().copied()).collect();
        let judged = judge.edge(&all, here().any(|r| r.line));
        let covered = here().next().is_some();
        report.coplanar += usize::from(covered && judged.is_none());
        let ends = [stops[k], stops[k + 1]].map(|s| points[s.1 as usize]);
        match (&mut open, judged) {
            (Some(edge), Some((kind, sheets))) if edge.kind == kind && alike(&edge.sheets, &sheets) => {
                edge.ends[1] = ends[1];
            }
            (_, judged) => {
                edges.extend(open.take());
                open = judged.map(|(kind, sheets)| Edge { ends, kind, sheets });
            }
        }
    }
    edges.extend(open);
}
