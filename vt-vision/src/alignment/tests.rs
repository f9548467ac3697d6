//! Derivatives of the measures against central differences, one law for all of them.

use proptest::prelude::*;
use vt_core::batch::{LANES, Row};

use super::Similarity;
use super::measure::{Influence, Measure, Pair};
use super::steepest::{self, Gradients, Matrix8, NOTHING, Points, Vector8};

/// Grey levels, weights, places and gradients of some points.
#[derive(Clone, Debug)]
struct Data {
    template: Vec<Row>,
    picture: Vec<Row>,
    weight: Vec<Row>,
    points: Points,
    gradients: [Gradients; 2],
}

impl Data {
    fn pair(&self) -> Pair<'_> {
        Pair { template: &self.template, picture: &self.picture, weight: &self.weight }
    }

    /// Steepest-descent rows of the template or the picture, point by point.
    fn rows(&self, which: usize) -> Vec<Vector8> {
        let g = &self.gradients[which];
        let at = |k: usize| {
            let (b, l) = (k / LANES, k % LANES);
            let j = steepest::rows(&self.points.x[b], &self.points.y[b], &g.x[b], &g.y[b]);
            Vector8::from_fn(|r, _| j[r][l])
        };
        (0..self.points.count).map(at).collect()
    }
}

/// Pictures that follow a curve of the template's grey levels, and noise.
fn data() -> impl Strategy<Value = Data> {
    let point = (0.0..255.0f64, -20.0..20.0f64, 0.2..1.0f64, prop::array::uniform6(-1.0..1.0f64));
    let points = prop::collection::vec(point, 70..150);
    (points, -0.9..0.9f64, -0.5..0.5f64).prop_filter_map("flat", |(all, gain, bend)| {
        let blocks = all.len().div_ceil(LANES);
        let rows = || vec![NOTHING; blocks];
        let gradients = || Gradients { x: rows(), y: rows() };
        let points = Points { x: rows(), y: rows(), count: all.len() };
        let (template, picture, weight) = (rows(), rows(), rows());
        let mut d = Data { template, picture, weight, points, gradients: [gradients(), gradients()] };
        for (k, (t, noise, w, rest)) in all.into_iter().enumerate() {
            let (b, k) = (k / LANES, k % LANES);
            d.template[b][k] = t;
            d.picture[b][k] = 120.0 + gain * (t - 128.0) + bend * (t - 128.0).powi(2) / 128.0 + noise;
            d.weight[b][k] = w;
            (d.points.x[b][k], d.points.y[b][k]) = (rest[0], rest[1]);
            let [g, h] = &mut d.gradients;
            (g.x[b][k], g.y[b][k], h.x[b][k], h.y[b][k]) = (rest[2], rest[3], rest[4], rest[5]);
        }
        (gain.abs() > 0.1).then_some(d)
    })
}

fn cost(measure: &mut dyn Measure, pair: Pair) -> f64 {
    measure.evaluate(pair, &mut Influence::default()).unwrap()
}

/// Central difference of fourth order.
fn slope(h: f64, mut f: impl FnMut(f64) -> f64) -> f64 {
    (8.0 * (f(h) - f(-h)) - (f(2.0 * h) - f(-2.0 * h))) / (12.0 * h)
}

proptest! {
    #[test]
    fn influences_are_derivatives(d in data(), at in any::<prop::sample::Index>()) {
        for similarity in Similarity::ALL {
            let mut measure = similarity.measure();
            measure.begin(d.pair());
            let mut influence = Influence::default();
            let value = measure.evaluate(d.pair(), &mut influence).unwrap();
            prop_assert!(value.is_finite() && measure.score().is_finite());
            let k = at.index(d.points.count);
            let (b, l) = (k / LANES, k % LANES);
            let t = d.template[b][l];
            let ends = |f: fn(f64, f64) -> f64, start| d.template.as_flattened()[..d.points.count].iter().copied().fold(start, f);
            let (low, high) = (ends(f64::min, f64::INFINITY), ends(f64::max, f64::NEG_INFINITY));
            // The ends of the range of the template's grey levels stay where they are, and a knot of the curve has a slope on either side.
            let knot = (t - low) / (high - low) * (super::regression::KNOTS - 1) as f64;
            let smooth = t > low + 0.01 && t < high - 0.01 && (knot - knot.round()).abs() > 0.01;
            if smooth {
                let found = slope(1e-3, |h| {
                    let mut moved = d.clone();
                    moved.template[b][l] += h;
                    measure.begin(moved.pair());
                    cost(&mut *measure, moved.pair())
                });
                let expected = influence.by_template[b][l];
                let size = influence.by_template.as_flattened().iter().map(|v| v.abs()).fold(0.0, f64::max);
                prop_assert!((found - expected).abs() < 1e-5 * size, "{similarity:?} {found} {expected}");
            }
            measure.begin(d.pair());
            let found = slope(1e-3, |h| {
                let mut moved = d.clone();
                moved.picture[b][l] += h;
                cost(&mut *measure, moved.pair())
            });
            let expected = influence.by_picture[b][l];
            let size = influence.by_picture.as_flattened().iter().map(|v| v.abs()).fold(0.0, f64::max);
            prop_assert!((found - expected).abs() < 1e-5 * size, "{similarity:?} {found} {expected}");
        }
    }

    /// Mixed derivatives of the information, by differences of its first ones: the template moves along `u`, the picture along `v`.
    #[test]
    fn the_curvature_of_information_is_the_negative_mixed_derivative(d in data(), u in prop::array::uniform8(-1.0..1.0f64), v in prop::array::uniform8(-1.0..1.0f64)) {
        let (u, v) = (Vector8::from(u), Vector8::from(v));
        let (of_template, of_picture) = (d.rows(0), d.rows(1));
        for similarity in [Similarity::MutualInformation, Similarity::NormalizedMutualInformation] {
            let mut measure = similarity.measure();
            measure.begin(d.pair());
            cost(&mut *measure, d.pair());
            let [template, picture] = &d.gradients;
            let curvature = measure.curvature(d.pair(), &d.points, template, Some(picture), &mut Gradients::default());
            let mut by_template = |h: f64| {
                let mut moved = d.clone();
                for (k, j) in of_picture.iter().enumerate() {
                    moved.picture[k / LANES][k % LANES] += h * j.dot(&v);
                }
                let mut out = Influence::default();
                measure.evaluate(moved.pair(), &mut out).unwrap();
                of_template.iter().enumerate().map(|(k, j)| out.by_template[k / LANES][k % LANES] * j.dot(&u)).sum::<f64>()
            };
            let one = -slope(1e-4, &mut by_template);
            // It is made symmetric: the other half by exchanging the two motions.
            let mut exchanged = |h: f64| {
                let mut moved = d.clone();
                for (k, j) in of_picture.iter().enumerate() {
                    moved.picture[k / LANES][k % LANES] += h * j.dot(&u);
                }
                let mut out = Influence::default();
                measure.evaluate(moved.pair(), &mut out).unwrap();
                of_template.iter().enumerate().map(|(k, j)| out.by_template[k / LANES][k % LANES] * j.dot(&v)).sum::<f64>()
            };
            let other = -slope(1e-4, &mut exchanged);
            let expected = 0.5 * (one + other);
            let found = u.dot(&(curvature * v));
            let size = curvature.norm() * u.norm() * v.norm();
            prop_assert!((found - expected).abs() < 2e-3 * size, "{similarity:?} {found} {expected} of {size}");
        }
    }

    /// With the rows held the costs of SSD and SCV are quadratic, and their curvature is exact; that of ZNCC is where the grey levels agree.
    #[test]
    fn the_curvature_of_regressions_is_that_of_the_linearised_cost(d in data(), u in prop::array::uniform8(-1.0..1.0f64), both in any::<bool>()) {
        let u = Vector8::from(u);
        for similarity in [Similarity::Ssd, Similarity::Scv, Similarity::Zncc] {
            let mut d = d.clone();
            if similarity == Similarity::Zncc {
                for (i, t) in d.picture.as_flattened_mut().iter_mut().zip(d.template.as_flattened()) {
                    *i = 30.0 + 0.7 * t;
                }
            }
            let mut measure = similarity.measure();
            cost(&mut *measure, d.pair());
            let [template, picture] = &d.gradients;
            let mut mixed = Gradients::default();
            let curvature = measure.curvature(d.pair(), &d.points, template, both.then_some(picture), &mut mixed);
            d.gradients[0] = mixed;
            let j = d.rows(0);
            let step = 1.0;
            let mut moved = |h: f64| {
                let mut moved = d.clone();
                for (k, j) in j.iter().enumerate() {
                    moved.picture[k / LANES][k % LANES] += h * j.dot(&u);
                }
                cost(&mut *measure, moved.pair())
            };
            let expected = (moved(step) + moved(-step) - 2.0 * moved(0.0)) / (step * step);
            let found = u.dot(&(curvature * u));
            let tolerance = if similarity == Similarity::Zncc { 1e-3 } else { 1e-6 };
            prop_assert!((found - expected).abs() < tolerance * expected + 1e-7 * curvature.norm(), "{similarity:?} {found} {expected}");
        }
    }

    /// Of a picture with itself every measure is at its optimum, and its curvature there is positive.
    #[test]
    fn curvatures_are_positive_at_the_optimum(d in data()) {
        for similarity in Similarity::ALL {
            let mut measure = similarity.measure();
            let pair = Pair { picture: &d.template, ..d.pair() };
            measure.begin(pair);
            cost(&mut *measure, pair);
            let h: Matrix8 = measure.curvature(pair, &d.points, &d.gradients[0], None, &mut Gradients::default());
            prop_assert!(h.symmetric_eigenvalues().min() > 0.0, "{similarity:?} {h}");
            prop_assert!((h - h.transpose()).norm() < 1e-12 * h.norm());
        }
    }

    /// Gain and bias do not change what a measure says; information does not ask for the sign of the gain either.
    #[test]
    fn scores_do_not_ask_for_the_light(d in data(), gain in 0.3..2.0f64, bias in -50.0..50.0f64) {
        for similarity in Similarity::ALL {
            let mut scores = [gain, -gain, 1.0].map(|gain| {
                let mut lit = d.clone();
                lit.picture.as_flattened_mut().iter_mut().for_each(|i| *i = gain * *i + bias);
                let mut measure = similarity.measure();
                measure.begin(lit.pair());
                cost(&mut *measure, lit.pair());
                measure.score()
            });
            if similarity == Similarity::Zncc {
                scores[1] = -scores[1];
            }
            prop_assert!(scores.iter().all(|s| (s - scores[2]).abs() < 1e-9), "{similarity:?} {scores:?}");
        }
    }
}

#[test]
fn flat_pictures_have_no_similarity() {
    let ramp: Vec<Row> = vec![core::array::from_fn(|k| k as f64); 2];
    let (flat, weight) = (vec![[7.0; LANES]; 2], vec![[1.0; LANES]; 2]);
    for similarity in Similarity::ALL {
        let mut measure = similarity.measure();
        let pair = Pair { template: &ramp, picture: &flat, weight: &weight };
        measure.begin(pair);
        assert_eq!(measure.evaluate(pair, &mut Influence::default()), None, "{similarity:?}");
    }
}
