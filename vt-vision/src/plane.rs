//! Values of the pixels of a region of a picture.

use vt_core::frame::Roi;

/// One value a pixel of a region, by rows; coordinates are those of the full picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane<T> {
    region: Roi,
    values: Vec<T>,
}

impl<T> Default for Plane<T> {
    fn default() -> Self {
        Self { region: Roi { x: 0, y: 0, width: 0, height: 0 }, values: vec![] }
    }
}

impl<T: Copy + Default> Plane<T> {
    /// The region for which there are values.
    pub fn region(&self) -> Roi {
        self.region
    }

    /// All values by rows.
    pub fn values(&self) -> &[T] {
        &self.values
    }

    /// All values by rows, to be changed.
    pub fn values_mut(&mut self) -> &mut [T] {
        &mut self.values
    }

    /// The value of a pixel of the picture; none outside of the region.
    #[inline]
    pub fn get(&self, x: u32, y: u32) -> Option<T> {
        let (u, v) = (x.wrapping_sub(self.region.x), y.wrapping_sub(self.region.y));
        let inside = u < self.region.width && v < self.region.height;
        inside.then(|| self.values[v as usize * self.region.width as usize + u as usize])
    }

    /// The part of a row of the picture that lies in `region`, which is cut to what there is.
    #[inline]
    pub fn row(&self, y: u32, region: Roi) -> &[T] {
        let part = intersection(self.region, region);
        if y < part.y || y - part.y >= part.height {
            return &[];
        }
        let start = (y - self.region.y) as usize * self.region.width as usize;
        &self.values[start + (part.x - self.region.x) as usize..][..part.width as usize]
    }

    /// Makes room for so many values in all, those of a whole picture, so that regions which grow take no memory later.
    pub fn reserve(&mut self, count: usize) {
        reserve(&mut self.values, count);
    }

    /// Number of values that there is room for.
    pub fn capacity(&self) -> usize {
        self.values.capacity()
    }

    /// Makes room for a region and lends all values, whatever they are, to be written.
    pub fn reshape(&mut self, region: Roi) -> &mut [T] {
        self.region = region;
        self.values.resize(region.width as usize * region.height as usize, T::default());
        &mut self.values
    }
}

/// Makes room for so many values in all.
pub(crate) fn reserve<T>(values: &mut Vec<T>, count: usize) {
    values.reserve(count.saturating_sub(values.len()));
}

/// Number of pixels of a picture.
pub(crate) fn area((width, height): (u32, u32)) -> usize {
    width as usize * height as usize
}

/// The part of `roi`, or of a picture of `size` pixels without one, that keeps `margin` pixels from the picture's border.
/// Width and height are zero where nothing is left.
pub fn clip(roi: Option<Roi>, size: (u32, u32), margin: u32) -> Roi {
    let free = |n: u32| n.saturating_sub(margin).saturating_sub(margin);
    let inner = Roi { x: margin, y: margin, width: free(size.0), height: free(size.1) };
    intersection(inner, roi.unwrap_or(inner))
}

/// Pixels that lie in both; width and height are zero where there are none.
pub fn intersection(a: Roi, b: Roi) -> Roi {
    let (x, y) = (a.x.max(b.x), a.y.max(b.y));
    let end = |p: u32, n: u32, q: u32, m: u32| p.saturating_add(n).min(q.saturating_add(m));
    let width = end(a.x, a.width, b.x, b.width).saturating_sub(x);
    let height = end(a.y, a.height, b.y, b.height).saturating_sub(y);
    if width == 0 || height == 0 {
        return Roi { x: a.x, y: a.y, width: 0, height: 0 };
    }
    Roi { x, y, width, height }
}

/// `region` with `margin` pixels more on every side, inside a picture of `size` pixels; an empty one stays empty.
pub fn grown(region: Roi, margin: u32, size: (u32, u32)) -> Roi {
    if region.width == 0 || region.height == 0 {
        return region;
    }
    let (x, y) = (region.x.saturating_sub(margin), region.y.saturating_sub(margin));
    let end = |p: u32, n: u32, limit: u32| p.saturating_add(n).saturating_add(margin).min(limit);
    let (right, bottom) = (end(region.x, region.width, size.0), end(region.y, region.height, size.1));
    Roi { x, y, width: right.saturating_sub(x), height: bottom.saturating_sub(y) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn roi() -> impl Strategy<Value = Roi> {
        let edge = || prop_oneof![0u32..12, Just(u32::MAX)];
        (0u32..12, 0u32..12, edge(), edge()).prop_map(|(x, y, width, height)| Roi { x, y, width, height })
    }

    fn holds(r: Roi, x: u32, y: u32) -> bool {
        x.checked_sub(r.x).is_some_and(|u| u < r.width) && y.checked_sub(r.y).is_some_and(|v| v < r.height)
    }

    proptest! {
        #[test]
        fn regions_hold_the_pixels_they_say(a in roi(), b in roi(), margin in 0u32..3, w in 0u32..12, h in 0u32..12) {
            let (both, inner) = (intersection(a, b), clip(Some(a), (w, h), margin));
            for y in 0..30 {
                for x in 0..30 {
                    prop_assert_eq!(holds(both, x, y), holds(a, x, y) && holds(b, x, y));
                    let free = x >= margin && y >= margin && x + margin < w && y + margin < h;
                    prop_assert_eq!(holds(inner, x, y), free && holds(a, x, y));
                }
            }
            if both.width > 0 && a.width < 12 && a.height < 12 {
                let mut plane = Plane::<u32>::default();
                for (k, v) in plane.reshape(a).iter_mut().enumerate() {
                    *v = k as u32;
                }
                for y in 0..30 {
                    let row: Vec<u32> = (0..30).filter(|&x| holds(both, x, y)).filter_map(|x| plane.get(x, y)).collect();
                    prop_assert_eq!(plane.row(y, b), &row[..]);
                }
            }
        }
    }
}
