//! A method of one's own: an estimator that a task can choose by name, without a change in any crate of ours.

use std::path::Path;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::agent::Estimator;
use vt_core::belief::Gaussian;
use vt_core::error::{ConfigError, EstimateError};
use vt_core::lie::SE3;
use vt_core::measurement::Measurement;
use vt_core::report::Innovation;
use vt_core::time::Seconds;
use vt_task::assembly::Scene;
use vt_task::language::Level;
use vt_task::registry::{Method, Params, Registry};
use vt_task::roles::{EstimatorContext, Estimators};
use vt_task::{Document, Problem, check};

/// Believes its prior for ever.
struct Stubborn(Gaussian<SE3>);

impl Estimator<SE3> for Stubborn {
    fn predict(&mut self, _: Seconds) -> Result<(), EstimateError> {
        Ok(())
    }
    fn correct(&mut self, _: &dyn Measurement<SE3>) -> Result<Innovation, EstimateError> {
        Ok(Innovation::default())
    }
    fn pose(&self) -> Gaussian<SE3> {
        self.0.clone()
    }
    fn reset(&mut self, prior: &Gaussian<SE3>) -> Result<(), EstimateError> {
        self.0 = prior.clone();
        Ok(())
    }
}

#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct StubbornParams {
    /// From 0 to 1.
    stubbornness: f64,
}

impl Params for StubbornParams {
    fn check(&self) -> Result<(), ConfigError> {
        match self.stubbornness {
            s if (0.0..=1.0).contains(&s) => Ok(()),
            s => Err(ConfigError::parameter("stubbornness", s, "a number from 0 to 1")),
        }
    }
}

fn build(_: StubbornParams, context: EstimatorContext<SE3>) -> Result<Box<dyn Estimator<SE3>>, ConfigError> {
    Ok(Box::new(Stubborn(context.prior)))
}

fn registry() -> Registry {
    let method =
        Method::<Estimators<SE3>>::new("stubborn", "believes its prior", build).levels(&[Level::Feature]);
    Registry::standard().with(method)
}

const TASK: &str = include_str!("../../tasks/edge-pose.toml");

fn document(set: &[&str]) -> Document {
    let set: Vec<String> = set.iter().map(|s| (*s).to_owned()).collect();
    Document::parse("task", TASK, Path::new(""), &set, &|_| None).unwrap()
}

const CHOOSE: &str = "targets.bracket.estimator={ kind = 'stubborn', params = { stubbornness = 0.5 } }";

#[test]
fn custom_estimator_is_checked_listed_and_described() {
    let registry = registry();
    check(&document(&[CHOOSE]), &registry).unwrap();
    assert!(check(&document(&[CHOOSE]), &Registry::standard()).is_err());
    let bad = document(&[CHOOSE, "targets.bracket.estimator.params.stubbornness=2"]);
    assert!(matches!(check(&bad, &registry).unwrap_err().problems[0].problem, Problem::Value { .. }));
    let level = document(&[CHOOSE, "targets.bracket.modalities.edges.level=object"]);
    assert!(matches!(check(&level, &registry).unwrap_err().problems[0].problem, Problem::Mismatch { .. }));
    assert!(vt_task::explain::table(&registry).contains("stubborn"));
    assert!(vt_task::schema::schema(&registry).to_string().contains("stubbornness"));
    let sheet = vt_task::explain::explain(&check(&document(&[CHOOSE]), &registry).unwrap(), &registry);
    assert!(sheet.contains("stubborn: believes its prior"));
}

#[test]
fn custom_estimator_runs_in_the_loop() {
    let (registry, document) = (registry(), document(&[CHOOSE, "sensors.camera.params.frames=3"]));
    let task = check(&document, &registry).unwrap();
    let mut scene = Scene::build(&document, &task, &registry).unwrap();
    let first = scene.sensors[0].next().unwrap().unwrap();
    let mut tracking = scene.tracking(&document, &task, &registry, std::slice::from_ref(&first)).unwrap();
    let before = tracking.step([first]).unwrap()[0].posterior.clone();
    let second = scene.sensors[0].next().unwrap().unwrap();
    let after = tracking.step([second]).unwrap()[0].posterior.clone();
    assert_eq!(before, after);
}
