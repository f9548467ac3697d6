//! From a checked task to things that run.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{DefaultAllocator, DimAdd, DimSum, Point2, U1};
use vt_core::agent::{LossDetector, Output, Sensor};
use vt_core::belief::Gaussian;
use vt_core::error::ConfigError;
use vt_core::evidence::Processing;
use vt_core::frame::{Frame, SensorId};
use vt_core::lie::SE3;
use vt_core::manifold::{Alloc, Coordinates, Tangent};
use vt_core::measurement::Modality;
use vt_core::report::{Assessment, Verdict};
use vt_fusion::loss::tolerated;
use vt_fusion::tracks::{BarShalomCampo, EquivalentMeasurements, Intersection, TrackFusion};
use vt_fusion::{AnyTarget, FusedTarget, Target, TrackingLoop};
use vt_io::boxes::Bounds;
use vt_io::report::Header;
use vt_io::summary::Summary;
use vt_io::truth::Truth;
use vt_models::camera::Camera;

use crate::document::Document;
use crate::error::{Problem, TaskErrors};
use crate::language::{ModelSection, TargetSection, Task};
use crate::node::Node;
use crate::reader::ReadError;
use crate::registry::{Registry, Role};
use crate::roles::{
    AppearanceProduct, Appearances, Body, EstimatorContext, Estimators, Freedom, FusionProduct, Fusions,
    Ground, InitContext, Inits, Losses, Modalities, ModalityContext, Motion, Motions, OutputContext, Outputs,
    Place, ReinitContext, ReinitProduct, Reinits, SensorContext, Sensors, Shapes, Start, StateAlloc,
    TrackRule, TruthContext, Truths, Warps,
};

/// Everything of a task that does not need a picture yet.
pub struct Scene {
    /// Sensors in the order of the task.
    pub sensors: Vec<Box<dyn Sensor>>,
    /// True poses of each target, where they are known.
    pub truths: Vec<Option<Truth>>,
    /// Whether each target starts at the true pose of the first frame, whatever its init says; the uncertainty stays
    /// that of the init.
    pub true_starts: Vec<bool>,
    cameras: Vec<Option<Camera>>,
    shapes: BTreeMap<String, Ground>,
    appearances: BTreeMap<String, AppearanceProduct>,
}

/// A target with the processing that it needs.
pub struct BuiltTarget {
    /// The target.
    pub target: Box<dyn AnyTarget>,
    /// Units of image processing.
    pub processing: Vec<Box<dyn Processing>>,
}

/// What the targets of a pose space are built from.
pub struct TargetContext<'a> {
    registry: &'a Registry,
    document: &'a Document,
    task: &'a Task,
    scene: &'a Scene,
    index: usize,
    first_frames: &'a [Frame],
}

/// Builds targets of one pose space.
pub(crate) type TargetBuilder = fn(&TargetContext<'_>) -> Result<BuiltTarget, ReadError>;

impl Scene {
    /// Reads models and opens sensors.
    ///
    /// # Errors
    /// [`TaskErrors`] where a file does not have the content it should have, at the place that names it.
    pub fn build(document: &Document, task: &Task, registry: &Registry) -> Result<Self, TaskErrors> {
        Self::new(document, task, registry).map_err(|e| document.error(e).into())
    }

    fn new(document: &Document, task: &Task, registry: &Registry) -> Result<Self, ReadError> {
        let place = Place { base: document.base() };
        let mut scene = Self {
            sensors: vec![],
            truths: vec![],
            true_starts: vec![false; task.targets.len()],
            cameras: vec![],
            shapes: shapes(document, task, registry)?,
            appearances: BTreeMap::new(),
        };
        for (k, model) in task.models.iter().enumerate() {
            let appearance = match document.root().at(&format!("models.{k}.appearance")) {
                Some(node) => registry.build::<Appearances>(node, place)?,
                None => AppearanceProduct::Unknown,
            };
            scene.appearances.insert(model.name.clone(), appearance);
        }
        let mut simulated = BTreeMap::new();
        for (k, section) in task.sensors.iter().enumerate() {
            let at = node(document, &format!("sensors.{k}"))?;
            let camera = section.camera.as_ref().map(|c| c.camera()).transpose();
            let camera = camera.map_err(|e| crate::registry::located(e, at.get("camera").unwrap_or(at)))?;
            let context = SensorContext {
                place,
                id: SensorId(k as u32),
                section,
                seed: task.seed.into(),
                camera: camera.as_ref(),
                shapes: &scene.shapes,
                simulated: &simulated,
            };
            let product = registry.build::<Sensors>(at, context)?;
            scene.sensors.push(product.sensor);
            scene.cameras.push(camera);
            simulated.extend(product.truth.map(|t| (section.name.clone(), t)));
        }
        for k in 0..task.targets.len() {
            let truth = document.root().at(&format!("targets.{k}.truth"));
            let context = TruthContext { place, simulated: &simulated };
            scene.truths.push(truth.map(|node| registry.build::<Truths>(node, context)).transpose()?);
        }
        Ok(scene)
    }

    /// Builds the tracking loop. The priors may depend on the first frames.
    ///
    /// # Errors
    /// [`TaskErrors`].
    pub fn tracking(
        &self,
        document: &Document,
        task: &Task,
        registry: &Registry,
        first_frames: &[Frame],
    ) -> Result<TrackingLoop, TaskErrors> {
        let mut targets = vec![];
        let mut processing = vec![];
        for (index, target) in task.targets.iter().enumerate() {
            let context = TargetContext { registry, document, task, scene: self, index, first_frames };
            let built = context.build(target).map_err(|e| document.error(e))?;
            targets.push(built.target);
            processing.extend(built.processing);
        }
        let mut tracking = TrackingLoop::new(targets);
        processing.into_iter().for_each(|unit| tracking.add_processing(unit));
        Ok(tracking)
    }

    /// An empty summary of the targets.
    pub fn summary(&self, task: &Task) -> Summary {
        let targets = task.targets.iter().zip(&self.truths);
        Summary::new(targets.map(|(t, truth)| (t.name.clone(), truth.clone(), self.bounds(&t.model))))
    }

    /// Corners of the bounds of a flat model.
    fn bounds(&self, model: &str) -> Bounds {
        let [low, high] = self.shapes.get(model)?.outline().ok()?.bounds();
        Some([low, Point2::new(high.x, low.y), high, Point2::new(low.x, high.y)])
    }

    /// Opens the outputs in `folder`.
    ///
    /// # Errors
    /// [`TaskErrors`] when something cannot be written.
    pub fn outputs(
        &self,
        document: &Document,
        task: &Task,
        registry: &Registry,
        folder: &Path,
        header: &Header,
    ) -> Result<Vec<Box<dyn Output>>, TaskErrors> {
        let targets: Vec<String> = task.targets.iter().map(|t| t.name.clone()).collect();
        let summary = self.summary(task);
        let bounds: Vec<Bounds> = task.targets.iter().map(|t| self.bounds(&t.model)).collect();
        let context = OutputContext {
            folder,
            targets: &targets,
            bounds: &bounds,
            sensors: &task.sensors,
            cameras: &self.cameras,
            header,
            summary: &summary,
        };
        let build = |k: usize| {
            let node = node(document, &format!("outputs.{k}"))?;
            registry.build::<Outputs>(node, context)
        };
        let built: Result<_, ReadError> = (0..task.outputs.len()).map(build).collect();
        built.map_err(|e| document.error(e).into())
    }
}

pub(crate) fn node<'a>(document: &'a Document, path: &str) -> Result<&'a Node, ReadError> {
    let root = document.root();
    root.at(path).ok_or_else(|| {
        let key = path.rsplit('.').next().unwrap_or(path).to_owned();
        ReadError::at(Problem::MissingKey { key }, root.deepest(path).span)
    })
}

/// Shapes of the models by name.
pub(crate) fn shapes(
    document: &Document,
    task: &Task,
    registry: &Registry,
) -> Result<BTreeMap<String, Ground>, ReadError> {
    let place = Place { base: document.base() };
    let shape = |(k, model): (usize, &ModelSection)| {
        let at = node(document, &format!("models.{k}.shape"))?;
        Ok((model.name.clone(), registry.build::<Shapes>(at, place)?))
    };
    task.models.iter().enumerate().map(shape).collect()
}

impl TargetContext<'_> {
    fn build(&self, target: &TargetSection) -> Result<BuiltTarget, ReadError> {
        let kind =
            self.task.models.iter().find(|m| m.name == target.model).map_or("", |m| m.warp.kind.as_str());
        let listings = self.registry.listings();
        let warp = listings.iter().find(|l| l.key == "warp" && l.kind == kind);
        let space = warp.and_then(|l| l.spaces.first().copied()).unwrap_or("");
        let builder = self.registry.target_builder(space).ok_or_else(|| {
            let problem = Problem::Mismatch {
                found: format!("warp `{kind}` of pose space {space}"),
                expected: "a pose space that the registry can build targets of".into(),
            };
            ReadError::at(problem, self.document.root().deepest(&format!("targets.{}", self.index)).span)
        })?;
        builder(self)
    }

    fn place(&self) -> Place<'_> {
        Place { base: self.document.base() }
    }

    fn optional<'a, R: Role>(
        &self,
        key: &str,
        context: R::Context<'a>,
    ) -> Result<Option<R::Product>, ReadError> {
        let path = format!("targets.{}.{key}", self.index);
        self.document.root().at(&path).map(|node| self.registry.build::<R>(node, context)).transpose()
    }
}

/// What is tried after a loss where the task says nothing.
pub(crate) const DEFAULT_REINIT: &str = "views";

/// Without a loss detector a target counts as tracked.
struct NeverLost;

impl LossDetector for NeverLost {
    fn assess(&mut self, _: &Assessment) -> Verdict {
        Verdict::default()
    }
    fn reset(&mut self) {}
}

/// The true pose of the first frame in the pose space `P`.
fn true_start<P: Coordinates>(init: &InitContext<'_>) -> Result<P, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let mut coordinates = vec![];
    init.true_pose()?.write(&mut coordinates);
    P::read(&coordinates).filter(|_| P::SPACE == SE3::SPACE).ok_or_else(|| ConfigError::Mismatch {
        found: format!("a start at the truth in the pose space {}", P::SPACE),
        expected: format!("a target of the space {}", SE3::SPACE),
    })
}

/// Deviations against which the spread of an estimate is judged: of bodies in space those of [`tolerated`], whatever the
/// start was like, of others those of the prior. Locked coordinates have 1.
fn judged_against<P: Coordinates>(prior: &Gaussian<P>, shape: &Ground) -> Tangent<P>
where
    DefaultAllocator: Alloc<P::D>,
{
    let body = shape.body().ok().filter(|_| P::SPACE == SE3::SPACE);
    let body = body.and_then(|body| Some(tolerated(body.flatten().ok()?.diameter())));
    Tangent::<P>::from_fn_generic(prior.mean.dim(), U1, |k, _| {
        let deviation = prior.covariance[(k, k)].sqrt();
        if deviation > 0.0 { body.map_or(deviation, |body| body[k]) } else { 1.0 }
    })
}

/// Builds a target of the pose space `P`.
pub(crate) fn build_target<P: Coordinates>(c: &TargetContext<'_>) -> Result<BuiltTarget, ReadError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let (registry, document, task) = (c.registry, c.document, c.task);
    let section = &task.targets[c.index];
    let path = format!("targets.{}", c.index);
    let model = task.models.iter().position(|m| m.name == section.model).unwrap_or(0);
    let freedom: Freedom =
        registry.build::<Warps<P>>(node(document, &format!("models.{model}.warp"))?, ())?;
    let sensor_of = |name: &str| task.sensors.iter().position(|s| s.name == name).unwrap_or(0);

    let mut sensors = vec![];
    let mut modalities: Vec<(SensorId, Box<dyn Modality<P>>)> = vec![];
    let mut processing = vec![];
    for (k, modality) in section.modalities.iter().enumerate() {
        let index = sensor_of(&modality.sensor);
        let context = ModalityContext {
            place: c.place(),
            sensor: SensorId(index as u32),
            camera: c.scene.cameras[index].as_ref(),
            picture: task.sensors[index].picture,
            level: modality.level,
            shape: &c.scene.shapes[&section.model],
            appearance: &c.scene.appearances[&section.model],
            freedom: &freedom,
        };
        let built =
            registry.build::<Modalities<P>>(node(document, &format!("{path}.modalities.{k}"))?, context)?;
        if !sensors.contains(&context.sensor) {
            sensors.push(context.sensor);
        }
        modalities.push((context.sensor, built.modality));
        processing.extend(built.processing);
    }

    let frames = c.first_frames;
    let index = sensors.first().map_or(0, |s: &SensorId| s.0 as usize);
    let body = Body {
        sensor: SensorId(index as u32),
        camera: c.scene.cameras.get(index).and_then(Option::as_ref),
        shape: &c.scene.shapes[&section.model],
        freedom: &freedom,
    };
    let first = frames.iter().find(|f| sensors.contains(&f.sensor)).or(frames.first());
    let init = InitContext {
        body,
        frames,
        place: c.place(),
        truth: c.scene.truths[c.index].as_ref(),
        first_frame: first.map_or(0, |f| f.number),
        freedom: &freedom,
    };
    let init_node = node(document, &format!("{path}.init"))?;
    let Start { mut prior, mut known } = registry.build::<Inits<P>>(init_node, init)?;
    if c.scene.true_starts.get(c.index).is_some_and(|wanted| *wanted) {
        prior.mean = true_start(&init).map_err(|e| crate::registry::located(e, init_node))?;
        known = true;
    }
    let motion =
        || registry.build::<Motions<P>>(node(document, &format!("models.{model}.dynamics"))?, &freedom);
    // Tracks of one target draw random numbers of their own.
    let estimator = |track: usize| {
        let target = c.index as u64 | (track as u64) << 32;
        let context =
            EstimatorContext { motion: motion()?, prior: prior.clone(), seed: task.seed.into(), target };
        registry.build::<Estimators<P>>(node(document, &format!("{path}.estimator"))?, context)
    };
    let loss = || {
        let loss: Option<Box<dyn LossDetector>> = c.optional::<Losses>("loss", ())?;
        Ok::<_, ReadError>(loss.unwrap_or_else(|| Box::new(NeverLost)))
    };
    let picture = task.sensors.get(index).map_or_else(Default::default, |s| s.picture);
    let reinitializer = || {
        let context = ReinitContext { prior: known.then_some(&prior), body, picture, frames };
        let chosen = match section.reinit {
            Some(_) => c.optional::<Reinits<P>>("reinit", context)?,
            // Where the method that is meant does not fit the body, a lost target coasts.
            None if section.loss.is_some() => {
                let method = registry.method::<Reinits<P>>(DEFAULT_REINIT);
                let node = Node::empty(document.root().span);
                method.and_then(|m| m.build(&node, context).ok())
            }
            None => None,
        };
        Ok::<_, ReadError>(chosen.unwrap_or_else(ReinitProduct::none))
    };
    let fusion = c.optional::<Fusions>("fusion", ())?;

    let scale = judged_against(&prior, &c.scene.shapes[&section.model]);
    let mut track = |name: String, sensors, modalities, number| {
        let ReinitProduct { reinitializer, processing: units } = reinitializer()?;
        processing.extend(units);
        let target =
            Target::new(name, sensors, modalities, estimator(number)?, loss()?, reinitializer, scale.clone());
        Ok::<_, ReadError>(if known { target } else { target.beginning_lost() })
    };
    let name = section.name.clone();
    let target: Box<dyn AnyTarget> = match fusion {
        Some(FusionProduct::Dynamic { rule, feedback }) => {
            let at = node(document, &format!("{path}.fusion"))?;
            let wrong = |e| crate::registry::located(e, at);
            let count = modalities.len();
            let rule: Box<dyn TrackFusion<P>> = match rule {
                TrackRule::Intersection(criterion) => Box::new(Intersection::new(criterion)),
                TrackRule::EquivalentMeasurements => Box::new(EquivalentMeasurements::new(estimator(count)?)),
                TrackRule::BarShalomCampo => match (motion()?, count) {
                    (Motion::Pose(motion), 2) => Box::new(BarShalomCampo::new(motion.0, &prior)),
                    (Motion::Pose(_), _) => {
                        let found = format!("{count} modalities");
                        return Err(wrong(ConfigError::Mismatch {
                            found,
                            expected: "two modalities".into(),
                        }));
                    }
                    _ => {
                        let found = "dynamics with a velocity".into();
                        let expected = "dynamics of the pose alone, such as `brownian`".into();
                        return Err(wrong(ConfigError::Mismatch { found, expected }));
                    }
                },
            };
            let tracks = modalities
                .into_iter()
                .enumerate()
                .map(|(k, (sensor, modality))| track(format!("{name}-{k}"), vec![sensor], vec![modality], k));
            let tracks = tracks.collect::<Result<Vec<_>, _>>()?;
            let fused = FusedTarget::new(name.clone(), tracks, rule, scale.clone());
            let fused = fused.map_err(|e| {
                wrong(ConfigError::Mismatch {
                    found: e.to_string(),
                    expected: "tracks that can be fused".into(),
                })
            })?;
            Box::new(if feedback { fused.with_feedback() } else { fused })
        }
        one => {
            let fusion =
                if let Some(FusionProduct::Static(fusion)) = one { fusion } else { Default::default() };
            let modalities = modalities.into_iter().map(|(_, modality)| modality).collect();
            Box::new(track(name, sensors, modalities, 0)?.with_fusion(fusion))
        }
    };
    Ok(BuiltTarget { target, processing })
}
