//! The methods of this project; adding one is one line here.

pub mod bodies;
#[cfg(feature = "opencv")]
pub mod capture;
pub mod contour;
pub mod edges;
pub mod estimator;
pub mod flat;
pub mod fusion;
pub mod init;
pub mod looks;
pub mod loss;
pub mod mass;
pub mod motion;
pub mod output;
pub mod particle;
pub mod planar;
pub mod planar_scene;
pub mod scene;
pub mod sensor;
pub mod shape;
pub mod simulation;
pub mod truth;
pub mod views;
pub mod warp;

use nalgebra::{DefaultAllocator, DimAdd, DimSum};
use vt_core::error::ConfigError;
use vt_core::lie::{Affine2, SE2, SE3, SL3, Sim2, TranslationScale, Vector};
use vt_core::manifold::Coordinates;

use crate::language::Level::{Feature, Object, Pixel};
use crate::language::Picture;
use crate::registry::{Method, NoParams, Registry};
use crate::roles::{
    AppearanceProduct, Appearances, Association, AssociationProduct, Deviations, Estimators, Fusions, Inits,
    Losses, Modalities, Motions, Outputs, Place, Reinits, Sensors, Shapes, StateAlloc, Truths, Warps,
};

/// Name of the pose space of bodies.
const SOLID: &[&str] = &[<SE3 as Coordinates>::SPACE];

impl Registry {
    /// All methods of this project.
    pub fn standard() -> Self {
        let bodies = estimators::<SE3, init::Sigma>(Self::empty());
        let flat = planar::<Vector<2>>(bodies, "translation", "flat model that is moved");
        let flat =
            planar::<TranslationScale>(flat, "translation-scale", "flat model that is moved and magnified");
        let flat = planar::<SE2>(flat, "se2", "flat model that is moved and turned");
        let flat = planar::<Sim2>(flat, "sim2", "flat model that is moved, turned and magnified");
        let flat = planar::<Affine2>(flat, "affine", "flat model under affine maps");
        #[cfg(feature = "opencv")]
        let flat =
            flat.with(Method::<Sensors>::new("opencv", "camera or stream, read by OpenCV", capture::opencv));
        planar::<SL3>(flat, "homography", "flat model under homographies")
            .with(Method::<Sensors>::new(
                "images",
                "pictures of a folder or by a numbered pattern",
                sensor::images,
            ))
            .with(Method::<Sensors>::new("video", "frames of a video file, read by ffmpeg", sensor::video))
            .with(Method::<Sensors>::new(
                "simulated",
                "a drawn scene with known poses",
                simulation::simulated,
            ))
            .with(Method::<Sensors>::new(
                "simulated-planar",
                "a drawn scene of a flat model",
                planar_scene::planar,
            ))
            .with(Method::<Shapes>::new(
                "mesh",
                "parts from VRML 97, OBJ, PLY, STL, glTF or CAO files",
                shape::mesh,
            ))
            .with(Method::<Shapes>::new(
                "bracket",
                "three cubic cells in an L, made in code",
                bodies::bracket,
            ))
            .with(Method::<Shapes>::new(
                "house",
                "house with dormer and chimney, made in code",
                bodies::house,
            ))
            .with(Method::<Shapes>::new("stairs", "four steps with a cheek, made in code", bodies::stairs))
            .with(Method::<Shapes>::new("wedge", "wedge with a slot, made in code", bodies::wedge))
            .with(Method::<Shapes>::new("tee", "flat T with a boss, made in code", bodies::tee))
            .with(Method::<Shapes>::new("cuboid", "box, made in code", bodies::cuboid))
            .with(Method::<Shapes>::new("rectangle", "flat rectangle about the origin", flat::rectangle))
            .with(Method::<Shapes>::new("ellipse", "flat ellipse about the origin", flat::ellipse))
            .with(Method::<Shapes>::new("polygon", "flat polygon", flat::polygon))
            .with(Method::<Shapes>::new("spline", "flat shape in a closed cubic B-spline", flat::spline))
            .with(Method::<Shapes>::new("svg", "flat shape in an SVG path", flat::svg))
            .with(Method::<Shapes>::new(
                "silhouette",
                "flat outline of a body in space, seen from a pose",
                flat::silhouette,
            ))
            .with(Method::<Appearances>::new("unknown", "nothing is known of the surface", unknown))
            .with(Method::<Warps<SE3>>::new("se3", "rigid body before a calibrated camera", warp::rigid))
            .with(Method::<Motions<SE3>>::new("brownian", "random walk of the pose", motion::brownian))
            .with(Method::<Motions<SE3>>::new("constant-velocity", "white acceleration", motion::velocity))
            .with(Method::<Motions<SE3>>::new("constant-acceleration", "white jerk", motion::acceleration))
            .with(Method::<Motions<SE3>>::new(
                "camera-velocity",
                "white acceleration, camera's frame",
                motion::camera,
            ))
            .with(Method::<Motions<SE3>>::new(
                "fading-velocity",
                "Ornstein-Uhlenbeck velocity",
                motion::fading,
            ))
            .with(Method::<Inits<SE3>>::new("pose", "a pose written in the task", init::pose))
            .with(Method::<Inits<SE3>>::new("file", "a pose from a file", init::file))
            .with(Method::<Inits<SE3>>::new("truth", "the true pose of the first frame", init::truth))
            .with(Method::<Inits<SE3>>::new("auto", "the body is searched in the first frame", views::auto))
            .with(Method::<Truths>::new("tum", "poses by frame from a file", truth::tum).spaces(SOLID))
            .with(Method::<Truths>::new("matrices", "a folder of 4x4 matrices", truth::matrices).spaces(SOLID))
            .with(
                Method::<Truths>::new("boxes", "x y width height of a flat target, a line a frame", truth::boxes)
                    .spaces(planar::FLAT),
            )
            .with(
                Method::<Truths>::new("corners", "four corners of a flat target, a line a frame", truth::corners)
                    .spaces(planar::FLAT),
            )
            .with(Method::<Truths>::new("simulated", "what a simulated sensor knows", truth::simulated))
            .with(
                Method::<Modalities<SE3>>::new("edges", "model contour against image edges", edges::edges)
                    .levels(&[Pixel, Feature, Object])
                    .picture(Picture::Grey)
                    .calibrated(),
            )
            .with(
                Method::<Fusions>::new(
                    "stacked",
                    "static: independent measurements are stacked",
                    fusion::stacked,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Fusions>::new(
                    "sequential",
                    "static: one measurement after the other",
                    fusion::sequential,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Fusions>::new(
                    "information-sum",
                    "static: one pose with the sum of information, linearised at the prediction",
                    fusion::information_sum,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Fusions>::new(
                    "intersection",
                    "dynamic: a track for each modality; covariance intersection",
                    fusion::intersection,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Fusions>::new(
                    "bar-shalom-campo",
                    "dynamic: a track for each of two modalities; best combination, motions of the pose alone",
                    fusion::bar_shalom_campo,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Fusions>::new(
                    "equivalent-measurements",
                    "dynamic: a track for each modality; a central filter of what they learn",
                    fusion::equivalent_measurements,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(Method::<Losses>::new(
                "fused",
                "support, surprise and spread in one probability",
                loss::fused,
            ))
            .with(Method::<Losses>::new("covariance", "the paper's test of the covariance", loss::covariance))
            .with(Method::<Reinits<SE3>>::new(
                "views",
                "as `prior`, then a search of the picture for all views of the model",
                views::views,
            ))
            .with(Method::<Association>::new("one-to-one", "each target measures for itself", one_to_one))
            .with(Method::<Outputs>::new("poses", "poses.tum: frame, position, quaternion", output::poses))
            .with(Method::<Outputs>::new(
                "covariances",
                "covariances.csv: frame and 21 values",
                output::covariances,
            ))
            .with(Method::<Outputs>::new(
                "boxes",
                "boxes.txt: x,y,width,height of flat targets",
                output::boxes,
            ))
            .with(Method::<Outputs>::new(
                "corners",
                "corners.txt: four corners of flat targets",
                output::corners,
            ))
            .with(Method::<Outputs>::new("steps", "steps.jsonl: all that a step knows", output::steps))
            .with(Method::<Outputs>::new("report", "report.json: conditions, errors, time", output::report))
            .with(Method::<Outputs>::new(
                "overlays",
                "pictures with model, measurements, state",
                output::overlays,
            ))
            .with(Method::<Outputs>::new("gif", "overlays.gif: overlays as an animation", output::gif))
            .with(Method::<Outputs>::new(
                "plot",
                "plot.png and plot.svg: errors, uncertainty, loss, time",
                output::plot,
            ))
    }
}

fn unknown(_: NoParams, _: Place<'_>) -> Result<AppearanceProduct, ConfigError> {
    Ok(AppearanceProduct::Unknown)
}

fn one_to_one(_: NoParams, _: ()) -> Result<AssociationProduct, ConfigError> {
    Ok(AssociationProduct::OneToOne)
}

/// The registry with all estimators, the re-initialisers that know no picture, and targets of a pose space; `B` says how
/// deviations are given.
fn estimators<P: Coordinates, B: Deviations<P> + Copy>(registry: Registry) -> Registry
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    registry
        .with_space::<P>()
        .with(Method::<Reinits<P>>::new("none", "a lost target coasts", views::none::<P>))
        .with(Method::<Reinits<P>>::new("prior", "the last trusted pose, then the prior", init::prior::<P>))
        .with(
            Method::<Estimators<P>>::new(
                "particle",
                "particle filter: bootstrap, auxiliary or annealed; Rao-Blackwellised; adaptive number",
                particle::particle::<P, B>,
            )
            .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new(
                "kalman",
                "extended or iterated Kalman filter",
                estimator::kalman::<P>,
            )
            .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new(
                "square-root",
                "Kalman filter by orthogonal transformations",
                estimator::square_root::<P>,
            )
            .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new(
                "information",
                "Kalman filter by information",
                estimator::information::<P>,
            )
            .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new("unscented", "unscented Kalman filter", estimator::unscented::<P>)
                .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new("cubature", "cubature Kalman filter", estimator::cubature::<P>)
                .levels(&[Pixel, Feature, Object]),
        )
        .with(
            Method::<Estimators<P>>::new(
                "imm",
                "interacting models: the motion in several strengths",
                estimator::models::<P>,
            )
            .levels(&[Pixel, Feature, Object]),
        )
}

/// The registry with flat models of one pose space, under the warp `kind`.
fn planar<P: planar::PlanarSpace>(registry: Registry, kind: &str, about: &str) -> Registry
where
    P::D: DimAdd<P::D>,
    DimSum<P::D, P::D>: DimAdd<P::D>,
    DefaultAllocator: StateAlloc<P::D>,
{
    estimators::<P, planar::PlanarSigma>(registry)
        .with(Method::<Warps<P>>::new(kind, about, planar::warp::<P>))
        .with(Method::<Motions<P>>::new("brownian", "random walk of the pose", planar::brownian::<P>))
        .with(Method::<Motions<P>>::new("constant-velocity", "white acceleration", planar::velocity::<P>))
        .with(Method::<Motions<P>>::new(
            "fading-velocity",
            "Ornstein-Uhlenbeck velocity",
            planar::fading::<P>,
        ))
        .with(Method::<Inits<P>>::new("pose", "a pose written in the task", planar::pose::<P>))
        .with(Method::<Inits<P>>::new("box", "the pose of a box in the picture", planar::on_box::<P>))
        .with(Method::<Reinits<P>>::new(
            "centre",
            "the start in the middle of the picture, as in the paper",
            planar::centre::<P>,
        ))
        .with(Method::<Reinits<P>>::new(
            "chamfer",
            "a search of the picture's edges for the outline",
            contour::search::<P>,
        ))
        .with(
            Method::<Modalities<P>>::new("contour", "outline against Canny edges", contour::contour::<P>)
                .levels(&[Pixel]),
        )
        .with(
            Method::<Modalities<P>>::new(
                "chamfer",
                "outline against the nearest edges",
                contour::chamfer::<P>,
            )
            .levels(&[Pixel]),
        )
        .with(
            Method::<Modalities<P>>::new("template", "correlation of grey levels", looks::template::<P>)
                .levels(&[Pixel]),
        )
        .with(
            Method::<Modalities<P>>::new("color", "colour histograms under a kernel", looks::color::<P>)
                .levels(&[Pixel])
                .picture(Picture::Colour),
        )
        .with(
            Method::<Modalities<P>>::new(
                "motion-centre",
                "mass centre of what moves",
                mass::motion_centre::<P>,
            )
            .levels(&[Object]),
        )
        .with(
            Method::<Modalities<P>>::new(
                "color-centre",
                "mass centre of the object's colours",
                mass::color_centre::<P>,
            )
            .levels(&[Object])
            .picture(Picture::Colour),
        )
        .with(Method::<Reinits<P>>::new(
            "back-projection",
            "the last trusted pose, then where the target's colours are",
            looks::back_projection::<P>,
        ))
}
