//! Parameters of the edge modality.

use vt_core::error::ConfigError;
use vt_core::measurement::Level;

/// How many edges on a search line may compete.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hypotheses {
    /// The edge nearest to the prediction only (RAPiD, Drummond–Cipolla; the paper's Fig. 10).
    Single,
    /// All edges on the line, weighted softly (Vacchetti 2004; the paper's Fig. 5).
    Multiple,
}

/// Parameters of [`EdgeModality`](super::EdgeModality); lengths in pixels of the full picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeParams {
    /// Level of the measurement that is handed out.
    pub level: Level,
    /// Competing edges on a line.
    pub hypotheses: Hypotheses,
    /// Smallest step in grey levels that counts as an edge.
    pub min_contrast: f64,
    /// Most edges kept on a line.
    pub max_candidates: usize,
    /// Shortest and longest half range of the search along a normal; between them the range is three deviations of
    /// the predicted contour.
    pub range: [f64; 2],
    /// Distance from the contour at which an edge point still counts as the contour's, as a standard deviation.
    pub sigma: f64,
    /// Expected standard deviation of the localisation of an edge point; the residuals of the picture correct it.
    pub localization: f64,
    /// Probability that a visible contour point gives no edge.
    pub miss_probability: f64,
    /// Clutter edges per pixel of search line.
    pub clutter_density: f64,
    /// Distance along a contour over which localisation errors are correlated; denser sites weigh less.
    pub correlation_length: f64,
    /// Most searches per frame; a search is repeated when the contour moved since the one before.
    pub searches: usize,
    /// Gauss–Newton steps after each search.
    pub iterations: usize,
    /// Most pyramid levels above the full picture, used where the prediction is uncertain by more than the range.
    pub coarse_levels: u32,
    /// Most starts spread over a prediction that is uncertain by more than the longest range.
    pub starts: u32,
    /// Divisor of the pixel-level log-likelihood (temperature), since neighbouring normals are not independent.
    pub temperature: f64,
}

impl Default for EdgeParams {
    fn default() -> Self {
        Self {
            level: Level::Feature,
            hypotheses: Hypotheses::Multiple,
            min_contrast: 5.0,
            max_candidates: 6,
            range: [6.0, 30.0],
            sigma: 0.4,
            localization: 0.05,
            miss_probability: 0.1,
            clutter_density: 0.03,
            correlation_length: 16.0,
            searches: 3,
            iterations: 8,
            coarse_levels: 3,
            starts: 24,
            temperature: 1.0,
        }
    }
}

impl EdgeParams {
    /// Checks all ranges.
    ///
    /// # Errors
    /// [`ConfigError::Parameter`] with the first parameter that is out of its range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let positive = |key, v: f64| {
            if v > 0.0 && v.is_finite() {
                Ok(())
            } else {
                Err(ConfigError::parameter(key, v, "a positive number"))
            }
        };
        positive("min_contrast", self.min_contrast)?;
        positive("sigma", self.sigma)?;
        positive("localization", self.localization)?;
        positive("clutter_density", self.clutter_density)?;
        positive("correlation_length", self.correlation_length)?;
        positive("temperature", self.temperature)?;
        positive("range", self.range[0])?;
        let longest = crate::edge_search::MAX_REACH as f64 / core::f64::consts::SQRT_2;
        if !(self.range[0] <= self.range[1] && self.range[1] <= longest) {
            let found = format!("[{}, {}]", self.range[0], self.range[1]);
            return Err(ConfigError::parameter(
                "range",
                found,
                format!("ascending and at most {longest:.0} px"),
            ));
        }
        if !(self.miss_probability > 0.0 && self.miss_probability < 1.0) {
            let expected = "a probability between 0 and 1, both excluded";
            return Err(ConfigError::parameter("miss_probability", self.miss_probability, expected));
        }
        for (key, v, low, high) in [
            ("max_candidates", self.max_candidates, 1, 32),
            ("searches", self.searches, 1, 20),
            ("iterations", self.iterations, 1, 100),
            ("coarse_levels", self.coarse_levels as usize, 0, 6),
            ("starts", self.starts as usize, 1, 1000),
        ] {
            if !(low..=high).contains(&v) {
                return Err(ConfigError::parameter(key, v, format!("{low} to {high}")));
            }
        }
        Ok(self)
    }
}
