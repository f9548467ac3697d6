//! Connected components of a mask, from runs of pixels along rows.

use vt_core::frame::Roi;

use crate::moments::Moments;
use crate::plane::Plane;

/// Which pixels touch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Connectivity {
    /// Those that share a side.
    Four,
    /// Those that share a side or a corner.
    #[default]
    Eight,
}

/// One connected component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Component {
    /// Smallest rectangle around it.
    pub region: Roi,
    /// Of its pixels, each with weight one.
    pub moments: Moments,
}

/// Pixels of one row that follow each other, within the region: row, first column, one past the last, component.
#[derive(Clone, Copy, Debug)]
struct Run {
    y: u32,
    start: u32,
    end: u32,
    label: u32,
}

/// Components of a region.
#[derive(Clone, Debug, Default)]
pub struct Components {
    region: Option<Roi>,
    runs: Vec<Run>,
    /// Of every label a lower one of the same component, or itself.
    parents: Vec<u32>,
    /// Component of every label.
    numbers: Vec<u32>,
    components: Vec<Component>,
}

impl Components {
    /// Finds the components of the pixels of `mask` that are not zero, in the order of their first pixel by rows.
    pub fn compute(&mut self, mask: &Plane<u8>, connectivity: Connectivity) {
        let region = mask.region();
        self.region = Some(region);
        self.runs.clear();
        self.parents.clear();
        self.components.clear();
        let reach = u32::from(connectivity == Connectivity::Eight);
        let mut above = 0..0;
        for (y, row) in (0..).zip(mask.values().chunks_exact(region.width.max(1) as usize)) {
            let begin = self.runs.len();
            let mut at = 0;
            while let Some(start) = row[at..].iter().position(|&m| m != 0).map(|k| at + k) {
                let end = row[start..].iter().position(|&m| m == 0).map_or(row.len(), |k| start + k);
                self.runs.push(Run { y, start: start as u32, end: end as u32, label: 0 });
                at = end;
            }
            self.join(above, begin, reach);
            above = begin..self.runs.len();
        }
        self.number();
    }

    /// Labels the runs from `begin` on by those of the row above that they touch.
    fn join(&mut self, above: core::ops::Range<usize>, begin: usize, reach: u32) {
        let mut first = above.start;
        for k in begin..self.runs.len() {
            let Run { start, end, .. } = self.runs[k];
            let mut label = None;
            while first < above.end && self.runs[first].end + reach <= start {
                first += 1;
            }
            for other in &self.runs[first..above.end] {
                if other.start >= end + reach {
                    break;
                }
                let root = root(&mut self.parents, other.label);
                label = Some(match label {
                    None => root,
                    Some(mine) => {
                        let (low, high) = (root.min(mine), root.max(mine));
                        self.parents[high as usize] = low;
                        low
                    }
                });
            }
            self.runs[k].label = label.unwrap_or_else(|| {
                self.parents.push(self.parents.len() as u32);
                self.parents.len() as u32 - 1
            });
        }
    }

    /// Gives every run the number of its component and adds up what belongs together.
    fn number(&mut self) {
        let Some(region) = self.region else { return };
        // A label's parent is never greater, and so has its number already.
        let mut count = 0;
        self.numbers.clear();
        for (k, &parent) in self.parents.iter().enumerate() {
            let known = self.numbers.get(parent as usize).copied();
            self.numbers.push(known.unwrap_or(count));
            count += u32::from(parent as usize == k);
        }
        for run in &mut self.runs {
            run.label = self.numbers[run.label as usize];
            let (x, y) = (region.x + run.start, region.y + run.y);
            let part = Roi { x, y, width: run.end - run.start, height: 1 };
            if run.label as usize == self.components.len() {
                self.components.push(Component { region: part, moments: Moments::default() });
            }
            let component = &mut self.components[run.label as usize];
            component.region = component.region.union(part);
            (x..x + part.width).for_each(|x| component.moments.add([f64::from(x), f64::from(y)], 1.0));
        }
    }

    /// The components.
    pub fn components(&self) -> &[Component] {
        &self.components
    }

    /// 1 + index of the component of every pixel, 0 for pixels without one.
    pub fn labels(&self, out: &mut Plane<u32>) {
        let region = self.region.unwrap_or(Roi { x: 0, y: 0, width: 0, height: 0 });
        let values = out.reshape(region);
        values.fill(0);
        for run in &self.runs {
            let row = &mut values[run.y as usize * region.width as usize..];
            row[run.start as usize..run.end as usize].fill(run.label + 1);
        }
    }
}

/// The label at the end of the chain; chains are halved on the way.
fn root(parents: &mut [u32], mut label: u32) -> u32 {
    while parents[label as usize] != label {
        parents[label as usize] = parents[parents[label as usize] as usize];
        label = parents[label as usize];
    }
    label
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn components_are_those_of_a_flood(
            (width, height) in (1usize..14, 1usize..14), draws in prop::collection::vec(0u8..5, 196), eight in any::<bool>(),
            rarity in 1u8..4,
        ) {
            let mut mask = Plane::default();
            let region = Roi { x: 5, y: 8, width: width as u32, height: height as u32 };
            for (m, &d) in mask.reshape(region).iter_mut().zip(&draws) {
                *m = if d < rarity { 200 } else { 0 };
            }
            let mut expected = vec![0u32; width * height];
            let mut count = 0;
            for k in 0..width * height {
                if mask.values()[k] == 0 || expected[k] != 0 {
                    continue;
                }
                count += 1;
                let mut open = vec![k];
                while let Some(at) = open.pop() {
                    if mask.values()[at] == 0 || expected[at] != 0 {
                        continue;
                    }
                    expected[at] = count;
                    let (x, y) = (at % width, at / width);
                    for v in y.saturating_sub(1)..(y + 2).min(height) {
                        for u in x.saturating_sub(1)..(x + 2).min(width) {
                            if eight || u == x || v == y {
                                open.push(v * width + u);
                            }
                        }
                    }
                }
            }
            let mut found = Components::default();
            found.compute(&mask, if eight { Connectivity::Eight } else { Connectivity::Four });
            let mut labels = Plane::default();
            found.labels(&mut labels);
            prop_assert_eq!(labels.values(), &expected[..]);
            prop_assert_eq!(found.components().len(), count as usize);
            for (k, component) in (1..).zip(found.components()) {
                let mut only = mask.clone();
                only.values_mut().iter_mut().zip(&expected).for_each(|(m, &l)| *m = u8::from(l == k));
                let exact = Moments::of_plane(&only, region);
                prop_assert_eq!(component.moments.mass(), exact.mass());
                let off = component.moments.centroid().unwrap() - exact.centroid().unwrap();
                prop_assert!(off.amax() < 1e-9 && (component.moments.spread() - exact.spread()).amax() < 1e-9);
                let pixels = || (0..width * height).filter(|&p| expected[p] == k).map(|p| ((p % width) as u32, (p / width) as u32));
                let (left, right) = (pixels().map(|p| p.0).min().unwrap(), pixels().map(|p| p.0).max().unwrap());
                let (top, bottom) = (pixels().map(|p| p.1).min().unwrap(), pixels().map(|p| p.1).max().unwrap());
                let roi = Roi { x: 5 + left, y: 8 + top, width: right - left + 1, height: bottom - top + 1 };
                prop_assert_eq!(component.region, roi);
            }
        }
    }
}
