//! Drawing primitives that trackers hand out; only applications turn them into pixels.

/// What a mark stands for; colours are the application's choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The model at the estimated pose.
    Model,
    /// Observation that supports the estimate.
    Inlier,
    /// Observation that contradicts the estimate.
    Outlier,
    /// Place that was searched without finding anything.
    Missing,
    /// Search line or other construction.
    Search,
    /// Uncertainty of the estimate.
    Uncertainty,
    /// One hypothesis.
    Particle,
}

/// One primitive in pixel coordinates (pixel centres at integers) of the sensor's picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Mark {
    /// Straight segment.
    Segment {
        /// One end.
        from: [f64; 2],
        /// Other end.
        to: [f64; 2],
        /// Meaning.
        role: Role,
    },
    /// Small dot.
    Point {
        /// Centre.
        at: [f64; 2],
        /// Meaning.
        role: Role,
    },
    /// Ellipse `{c + S u : |u| = 1}`, `S` the symmetric root of `shape`.
    Ellipse {
        /// Centre.
        center: [f64; 2],
        /// `[xx, xy, yy]` in px², already scaled to the confidence drawn.
        shape: [f64; 3],
        /// Meaning.
        role: Role,
    },
}
