//! The methods of this project; adding one is one line here.

pub mod bodies;
pub mod edges;
pub mod estimator;
pub mod fusion;
pub mod init;
pub mod loss;
pub mod motion;
pub mod output;
pub mod particle;
pub mod scene;
pub mod sensor;
pub mod shape;
pub mod simulation;
pub mod truth;
pub mod views;
pub mod warp;

use vt_core::error::ConfigError;
use vt_core::lie::SE3;

use crate::language::Level::{Feature, Object, Pixel};
use crate::language::Picture;
use crate::registry::{Method, NoParams, Registry};
use crate::roles::{
    AppearanceProduct, Appearances, Association, AssociationProduct, Estimators, Fusions, Inits, Losses,
    Modalities, Motions, Outputs, Place, Reinits, Sensors, Shapes, Truths, Warps,
};

impl Registry {
    /// All methods of this project.
    pub fn standard() -> Self {
        Self::empty()
            .with_space::<SE3>()
            .with(Method::<Sensors>::new(
                "images",
                "pictures of a folder or by a numbered pattern",
                sensor::images,
            ))
            .with(Method::<Sensors>::new(
                "simulated",
                "a drawn scene with known poses",
                simulation::simulated,
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
            .with(Method::<Truths>::new("tum", "poses by frame from a file", truth::tum))
            .with(Method::<Truths>::new("matrices", "a folder of 4x4 matrices", truth::matrices))
            .with(Method::<Truths>::new("simulated", "poses of a simulated sensor", truth::simulated))
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
            .with(
                Method::<Estimators<SE3>>::new(
                    "particle",
                    "particle filter: bootstrap, auxiliary or annealed; Rao-Blackwellised; adaptive number",
                    particle::particle,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new(
                    "kalman",
                    "extended or iterated Kalman filter",
                    estimator::kalman,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new(
                    "square-root",
                    "Kalman filter by orthogonal transformations",
                    estimator::square_root,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new(
                    "information",
                    "Kalman filter by information",
                    estimator::information,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new("unscented", "unscented Kalman filter", estimator::unscented)
                    .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new("cubature", "cubature Kalman filter", estimator::cubature)
                    .levels(&[Pixel, Feature, Object]),
            )
            .with(
                Method::<Estimators<SE3>>::new(
                    "imm",
                    "interacting models: the motion in several strengths",
                    estimator::models,
                )
                .levels(&[Pixel, Feature, Object]),
            )
            .with(Method::<Losses>::new(
                "fused",
                "support, surprise and spread in one probability",
                loss::fused,
            ))
            .with(Method::<Losses>::new("covariance", "the paper's test of the covariance", loss::covariance))
            .with(Method::<Reinits<SE3>>::new("none", "a lost target coasts", views::none))
            .with(Method::<Reinits<SE3>>::new("prior", "the last trusted pose, then the prior", init::prior))
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
