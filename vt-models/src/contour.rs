//! Contours as chains of points: the neighbours of a point, warped, give its normal in the picture (paper §6).

use nalgebra::{Point2, Vector2};
use vt_core::error::ConfigError;

/// Points along closed contours, each with the one before and the one after it.
///
/// Normals belong to the picture and not to the model: whatever the warp does to the shape, the neighbours `i−1` and
/// `i+1` of a warped point give its tangent there.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contour<B> {
    points: Vec<B>,
    links: Vec<[u32; 2]>,
}

impl<B> Contour<B> {
    /// Points with the index of the point after each.
    ///
    /// # Errors
    /// Where `next` does not lead through all points in closed chains of at least three.
    pub fn new(points: Vec<B>, next: &[u32]) -> Result<Self, ConfigError> {
        let n = points.len();
        let mut links = vec![[u32::MAX, 0]; n];
        let wrong =
            |found: String| ConfigError::parameter("next", found, format!("closed chains of {n} points"));
        if next.len() != n {
            return Err(wrong(format!("{} indices", next.len())));
        }
        for (k, &ahead) in next.iter().enumerate() {
            links[k][1] = ahead;
            match links.get_mut(ahead as usize) {
                Some(link) if link[0] == u32::MAX => link[0] = k as u32,
                _ => return Err(wrong(format!("{k} → {ahead}"))),
            }
        }
        match links.iter().position(|[before, after]| before == after) {
            Some(k) => Err(wrong(format!("a chain of two or fewer at {k}"))),
            None => Ok(Self { points, links }),
        }
    }

    /// One closed chain of points in order.
    ///
    /// # Errors
    /// With fewer than three points.
    pub fn closed(points: Vec<B>) -> Result<Self, ConfigError> {
        let n = points.len() as u32;
        let next: Vec<u32> = (0..n).map(|k| (k + 1) % n).collect();
        Self::new(points, &next)
    }

    /// The points.
    #[must_use]
    pub fn points(&self) -> &[B] {
        &self.points
    }

    /// Indices of the points before and after each.
    #[must_use]
    pub fn links(&self) -> &[[u32; 2]] {
        &self.links
    }

    /// The same chains of other points, such as those of a plane in space.
    #[must_use]
    pub fn map<C>(&self, f: impl FnMut(&B) -> C) -> Contour<C> {
        Contour { points: self.points.iter().map(f).collect(), links: self.links.clone() }
    }
}

/// Unit normal of a contour that runs from `before` to `after`, outwards where the area that it encloses is positive;
/// `None` where they coincide.
#[inline]
#[must_use]
pub fn normal(before: &Point2<f64>, after: &Point2<f64>) -> Option<Vector2<f64>> {
    let along = after - before;
    let squared = along.norm_squared();
    (squared > 0.0).then(|| Vector2::new(along.y, -along.x) * (1.0 / squared.sqrt()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chains_close_or_are_refused() {
        let two = Contour::new(vec![0, 1, 2, 3, 4, 5], &[1, 2, 0, 4, 5, 3]).unwrap();
        assert_eq!(two.links()[0], [2, 1]);
        assert_eq!(two.links()[3], [5, 4]);
        assert_eq!(two.map(|k| k * 2).points(), [0, 2, 4, 6, 8, 10]);
        assert_eq!(Contour::closed(vec!['a', 'b', 'c']).unwrap().links(), [[2, 1], [0, 2], [1, 0]]);
        for next in [&[1, 2, 0][..], &[1, 2, 3, 3], &[1, 0, 3, 2], &[1, 2, 3, 9], &[0, 1, 2, 3]] {
            let error = Contour::new(vec![0, 1, 2, 3], next).unwrap_err().to_string();
            assert!(error.contains("closed chains of 4 points"), "{error}");
        }
        assert!(Contour::closed(vec![1, 2]).is_err() && Contour::<u8>::closed(vec![]).is_ok());
    }

    #[test]
    fn normals_point_outwards_and_need_two_places() {
        let n = normal(&Point2::new(1.0, 1.0), &Point2::new(4.0, 5.0)).unwrap();
        assert!((n - Vector2::new(0.8, -0.6)).norm() < 1e-15);
        assert_eq!(normal(&Point2::origin(), &Point2::origin()), None);
        assert_eq!(normal(&Point2::new(f64::NAN, 0.0), &Point2::origin()), None);
    }
}
