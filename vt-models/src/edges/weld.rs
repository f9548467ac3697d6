use nalgebra::Point3;
use std::collections::HashMap;

/// Gives points closer than `tolerance` one id; returns the id of each point and one position per id.
///
/// The first point of a neighbourhood represents it, so the result depends on the input order only within the
/// tolerance. The map is looked up, never iterated.
pub(crate) fn weld(points: &[Point3<f64>], tolerance: f64) -> (Vec<u32>, Vec<Point3<f64>>) {
    let cell = |p: &Point3<f64>| [p.x, p.y, p.z].map(|c| (c / tolerance).floor() as i64);
    let mut grid: HashMap<[i64; 3], Vec<u32>> = HashMap::with_capacity(points.len());
    let mut unique: Vec<Point3<f64>> = Vec::new();
    let ids = points
        .iter()
        .map(|p| {
            let [x, y, z] = cell(p);
            let mut near: Option<(f64, u32)> = None;
            for dx in -1..=1 {
                for dy in -1..=1 {
                    for dz in -1..=1 {
                        let key = [x.saturating_add(dx), y.saturating_add(dy), z.saturating_add(dz)];
                        for &id in grid.get(&key).into_iter().flatten() {
                            let d = (unique[id as usize] - p).norm();
                            if d <= tolerance && near.is_none_or(|n| (d, id) < n) {
                                near = Some((d, id));
                            }
                        }
                    }
                }
            }
            near.map_or_else(
                || {
                    let id = unique.len() as u32;
                    unique.push(*p);
                    grid.entry([x, y, z]).or_default().push(id);
                    id
                },
                |n| n.1,
            )
        })
        .collect();
    (ids, unique)
}
