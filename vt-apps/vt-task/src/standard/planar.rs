//! Motions of the picture plane: their deviations, motion models and priors.

use nalgebra::{DefaultAllocator, Dim, DimAdd, DimSum, Point2, U1, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use vt_core::belief::Gaussian;
use vt_core::dynamics::{Brownian, ConstantVelocity, OrnsteinUhlenbeck};
use vt_core::error::ConfigError;
use vt_core::lie::{Affine2, LieGroup, PlanarMotion, SE2, SL3, Sim2, TranslationScale, Vector};
use vt_core::manifold::{Alloc, Coordinates, Tangent};
use vt_core::time::Seconds;
use vt_fusion::reinitialization::PriorPoses;
use vt_models::outline::Outline;

use super::init::around;
use crate::quantity::{
    Angle, AngularDiffusion, AngularSpeed, AngularSpeedDiffusion, PixelDiffusion, PixelSpeed,
    PixelSpeedDiffusion, Pixels, Share, ShareDiffusion, ShareSpeed, ShareSpeedDiffusion, Span,
};
use crate::registry::{NoParams, Params};
use crate::roles::{
    Chosen, Deviations, Freedom, InitContext, Motion, ReinitContext, ReinitProduct, Start, StateAlloc,
};

/// What a coordinate of the tangent does to the plane.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Axis {
    /// Moves it.
    Shift,
    /// Turns it.
    Turn,
    /// Magnifies it.
    Scale,
    /// Stretches or shears it.
    Shear,
    /// Tilts it.
    Tilt,
}

/// A pose space of flat models, by the meaning of its coordinates.
pub trait PlanarSpace: PlanarMotion
where
    DefaultAllocator: Alloc<Self::D>,
{
    /// In tangent order.
    const AXES: &'static [Axis];
}

macro_rules! spaces {
    ($($space:ty, [$($axis:ident),+];)+) => {$(
        impl PlanarSpace for $space {
            const AXES: &'static [Axis] = &[$(Axis::$axis),+];
        }
    )+

    /// Names of the pose spaces of flat models.
    pub(super) const FLAT: &[&str] = &[$(<$space as Coordinates>::SPACE),+];
    };
}

spaces! {
    Vector<2>, [Shift, Shift];
    TranslationScale, [Shift, Shift, Scale];
    SE2, [Shift, Shift, Turn];
    Sim2, [Shift, Shift, Turn, Scale];
    Affine2, [Shift, Shift, Turn, Scale, Shear, Shear];
    SL3, [Shift, Shift, Turn, Scale, Shear, Shear, Tilt, Tilt];
}

/// Pixels over which a tilt changes the scale by its share.
const TILTED: f64 = 100.0;

/// Declares one value for each kind of coordinate of a planar pose space.
macro_rules! values {
    ($($(#[$doc:meta])* $name:ident: $shift:ty, $turn:ty, $share:ty;)+) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(deny_unknown_fields)]
        pub struct $name {
            /// Of each coordinate of the position.
            pub translation: $shift,
            /// Of the orientation, where the space has one; none when absent.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub rotation: Option<$turn>,
            /// Of the scale, where the space has one; none when absent.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub scale: Option<$share>,
            /// Of stretch and shear, where the space has them; none when absent.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub shear: Option<$share>,
            /// Of the tilt, where the space has one, as change of scale over 100 px; none when absent.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            pub tilt: Option<$share>,
        }

        impl $name {
            fn optional(&self) -> [(&'static str, Axis, Option<f64>); 4] {
                [
                    ("rotation", Axis::Turn, self.rotation.map(|v| v.si())),
                    ("scale", Axis::Scale, self.scale.map(|v| v.si())),
                    ("shear", Axis::Shear, self.shear.map(|v| v.si())),
                    ("tilt", Axis::Tilt, self.tilt.map(|v| v.si() / TILTED)),
                ]
            }
        }

        impl Params for $name {
            fn check(&self) -> Result<(), ConfigError> {
                let all = self.optional().into_iter().filter_map(|(key, _, v)| Some((key, v?)));
                match core::iter::once(("translation", self.translation.si())).chain(all).find(|(_, v)| *v < 0.0) {
                    Some((key, v)) => Err(ConfigError::parameter(key, v, "zero or a positive value")),
                    None => Ok(()),
                }
            }
        }

        impl<P: PlanarSpace> Deviations<P> for $name
        where
            DefaultAllocator: Alloc<P::D>,
        {
            fn tangent(&self) -> Result<Tangent<P>, ConfigError> {
                let optional = self.optional();
                let strange = optional.iter().find(|(_, axis, v)| v.is_some() && !P::AXES.contains(axis));
                if let Some((key, ..)) = strange {
                    let expected = format!("a coordinate of the pose space {}", P::SPACE);
                    return Err(ConfigError::parameter(key, format!("`{key}`"), expected));
                }
                let value = |axis: Axis| match optional.iter().find(|(_, a, _)| *a == axis) {
                    Some((_, _, v)) => v.unwrap_or(0.0),
                    None => self.translation.si(),
                };
                let dim = P::D::from_usize(P::AXES.len());
                Ok(Tangent::<P>::from_fn_generic(dim, U1, |k, _| value(P::AXES[k])))
            }
        }
    )+};
}

values! {
    /// Deviations of a pose in the picture plane.
    PlanarSigma: Pixels, Angle, Share;
    /// Parameters of the dynamics `brownian` in the picture plane: random walks.
    PlanarDiffusion: PixelDiffusion, AngularDiffusion, ShareDiffusion;
    /// White acceleration in the picture plane.
    PlanarAcceleration: PixelSpeedDiffusion, AngularSpeedDiffusion, ShareSpeedDiffusion;
    /// Deviations of velocities in the picture plane.
    PlanarSpeed: PixelSpeed, AngularSpeed, ShareSpeed;
}

/// Parameters of the dynamics `constant-velocity` in the picture plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanarVelocity {
    /// White acceleration.
    pub acceleration: PlanarAcceleration,
    /// Deviation of the velocity at the start and after a re-initialisation.
    pub speed: PlanarSpeed,
}

impl Params for PlanarVelocity {
    fn check(&self) -> Result<(), ConfigError> {
        self.acceleration.check()?;
        self.speed.check()
    }
}

/// Parameters of the dynamics `fading-velocity` in the picture plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanarFading {
    /// Time in which a velocity falls to a third.
    pub fades_in: Span,
    /// White acceleration.
    pub acceleration: PlanarAcceleration,
    /// Deviation of the velocity at the start and after a re-initialisation.
    pub speed: PlanarSpeed,
}

impl Params for PlanarFading {
    fn check(&self) -> Result<(), ConfigError> {
        if self.fades_in.si() <= 0.0 {
            return Err(ConfigError::parameter("fades_in", self.fades_in, "a positive time"));
        }
        self.acceleration.check()?;
        self.speed.check()
    }
}

/// All coordinates are free; what has neither uncertainty nor noise keeps its value.
pub(super) fn warp<P: PlanarSpace>(_: NoParams, _: ()) -> Result<Freedom, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    Ok(Freedom(vec![true; P::AXES.len()]))
}

pub(super) fn brownian<P: PlanarSpace>(p: PlanarDiffusion, _: &Freedom) -> Result<Motion<P>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let density: Tangent<P> = Deviations::<P>::tangent(&p)?.map(|s| s * s);
    Ok(Motion::Pose(Chosen(Box::new(Brownian::new(density)?))))
}

pub(super) fn velocity<P: PlanarSpace>(p: PlanarVelocity, _: &Freedom) -> Result<Motion<P>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let density: Tangent<P> = Deviations::<P>::tangent(&p.acceleration)?.map(|s| s * s);
    Ok(Motion::Moving(
        Chosen(Box::new(ConstantVelocity::new(density)?)),
        vec![Deviations::<P>::tangent(&p.speed)?],
    ))
}

pub(super) fn fading<P: PlanarSpace>(p: PlanarFading, _: &Freedom) -> Result<Motion<P>, ConfigError>
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    let density: Tangent<P> = Deviations::<P>::tangent(&p.acceleration)?.map(|s| s * s);
    let model = OrnsteinUhlenbeck::new(Seconds(p.fades_in.si()), density)?;
    Ok(Motion::Moving(Chosen(Box::new(model)), vec![Deviations::<P>::tangent(&p.speed)?]))
}

/// A pose in the picture plane: `x ↦ scale · R(rotation) x + translation`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanarPose {
    /// Where the origin of the model lies.
    pub translation: [Pixels; 2],
    /// From the x axis of the picture to its y axis.
    #[serde(default)]
    pub rotation: Angle,
    /// Pixels for each unit of the model.
    #[serde(default = "one")]
    pub scale: f64,
}

fn one() -> f64 {
    1.0
}

/// Parameters of the init `pose` in the picture plane.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitPlanar {
    /// The pose.
    pub picture_from_object: PlanarPose,
    /// Its uncertainty.
    pub sigma: PlanarSigma,
}

impl Params for InitPlanar {
    fn check(&self) -> Result<(), ConfigError> {
        let scale = self.picture_from_object.scale;
        if !(scale > 0.0 && scale.is_finite()) {
            return Err(ConfigError::parameter("picture_from_object.scale", scale, "a positive number"));
        }
        self.sigma.check()
    }
}

/// Parameters of the init `box`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitBox {
    /// Left and upper border, width and height.
    #[serde(rename = "box")]
    pub bounds: [Pixels; 4],
    /// Uncertainty of the pose.
    pub sigma: PlanarSigma,
}

impl Params for InitBox {
    fn check(&self) -> Result<(), ConfigError> {
        if let Some(side) = self.bounds[2..].iter().find(|s| s.si() <= 0.0) {
            return Err(ConfigError::parameter("box", side, "a positive width and height"));
        }
        self.sigma.check()
    }
}

pub(super) fn pose<P: PlanarSpace>(p: InitPlanar, context: InitContext<'_>) -> Result<Start<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let PlanarPose { translation: [x, y], rotation, scale } = p.picture_from_object;
    let pose = P::of(&Sim2::new(x.si(), y.si(), rotation.si(), scale));
    Ok(around(pose, &p.sigma, &context)?.into())
}

/// The upright pose whose image of the shape has the centre and, where the space has a scale, the area of the box.
pub(super) fn on_box<P: PlanarSpace>(p: InitBox, context: InitContext<'_>) -> Result<Start<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let pose = fit(context.body.shape.outline()?, p.bounds.map(|v| v.si()), P::AXES.contains(&Axis::Scale));
    Ok(around(P::of(&pose), &p.sigma, &context)?.into())
}

/// The pose that brings the bounds of a shape onto the box `x y width height`, whose first pixel is `(x, y)`.
pub fn fit(outline: &Outline, [x, y, width, height]: [f64; 4], scaled: bool) -> Sim2 {
    let [low, high] = outline.bounds();
    let size = high - low;
    let scale = if scaled { (width * height / (size.x * size.y)).sqrt() } else { 1.0 };
    let middle = Point2::from((low.coords + high.coords) / 2.0);
    // Pixels have their centre at whole coordinates, their borders half a pixel off.
    let centre = Vector2::new(x + (width - 1.0) / 2.0, y + (height - 1.0) / 2.0);
    let translation = centre - middle.coords * scale;
    Sim2::new(translation.x, translation.y, 0.0, scale)
}

/// Parameters of the re-initialiser `centre`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ReinitCentre {
    /// Uncertainty about the middle of the picture, and about angle and scale of the start.
    pub sigma: PlanarSigma,
}

impl Params for ReinitCentre {
    fn check(&self) -> Result<(), ConfigError> {
        self.sigma.check()
    }
}

/// The paper's prior after a loss: as at the start, but in the middle of the picture.
pub(super) fn centre<P: PlanarSpace>(
    p: ReinitCentre,
    context: ReinitContext<'_, P>,
) -> Result<ReinitProduct<P>, ConfigError>
where
    DefaultAllocator: Alloc<P::D>,
{
    let (body, frames) = (context.body, context.frames);
    let frame = frames.iter().find(|f| f.sensor == body.sensor);
    let size = frame.and_then(|f| f.payload.size()).ok_or_else(|| ConfigError::Mismatch {
        found: "a sensor without a first picture".into(),
        expected: "a picture, whose middle is the prior".into(),
    })?;
    let [low, high] = body.shape.outline()?.bounds();
    let start = context.prior.map_or_else(Sim2::identity, |prior| prior.mean.similarity());
    let middle = Vector2::from(size.map(|n| f64::from(n) - 1.0)) / 2.0;
    let shift = middle - start.act(&nalgebra::center(&low, &high)).coords + start.translation;
    let mean = P::of(&Sim2 { translation: shift, ..start });
    let prior = Gaussian::from_sigmas(mean, &Deviations::<P>::tangent(&p.sigma)?);
    Ok(ReinitProduct::of_frames(PriorPoses { priors: vec![prior], last_trusted: None }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector4;
    use vt_core::lie::LieGroup;

    fn sigma(rotation: Option<f64>) -> PlanarSigma {
        PlanarSigma {
            translation: Pixels::new(3.0, "px").unwrap(),
            rotation: rotation.map(|r| Angle::new(r, "rad").unwrap()),
            scale: Share::new(5.0, "%"),
            shear: None,
            tilt: None,
        }
    }

    #[test]
    fn deviations_go_to_the_coordinates_of_the_space() {
        let tangent: Vector4<f64> = Deviations::<Sim2>::tangent(&sigma(Some(0.1))).unwrap();
        assert_eq!(tangent, Vector4::new(3.0, 3.0, 0.1, 0.05));
        let homography: Tangent<SL3> = Deviations::<SL3>::tangent(&sigma(None)).unwrap();
        assert_eq!(homography.as_slice(), [3.0, 3.0, 0.0, 0.05, 0.0, 0.0, 0.0, 0.0]);
        let e = Deviations::<TranslationScale>::tangent(&sigma(Some(0.1))).unwrap_err().to_string();
        assert!(e.contains("rotation") && e.contains("translation-scale"), "{e}");
        let e = Deviations::<Vector<2>>::tangent(&sigma(None)).unwrap_err().to_string();
        assert!(e.contains("scale"), "{e}");
    }

    #[test]
    fn a_box_is_filled_by_the_shape() {
        let outline = Outline::rectangle(20.0, 10.0).unwrap();
        let pose = fit(&outline, [100.0, 50.0, 40.0, 20.0], true);
        // The first pixel's outer corner.
        let corner = pose.act(&Point2::new(-10.0, -5.0));
        assert!((corner - Point2::new(99.5, 49.5)).norm() < 1e-12, "{corner}");
        assert!((pose.scale - 2.0).abs() < 1e-12);
        assert_eq!(fit(&outline, [100.0, 50.0, 40.0, 20.0], false).scale, 1.0);
    }
}
