//! The methods of this project; adding one is one line here.

pub mod init;
pub mod output;
pub mod sensor;
pub mod shape;
pub mod truth;

use vt_core::error::ConfigError;

use crate::registry::{Method, NoParams, Registry};
use crate::roles::{
    AppearanceProduct, Appearances, Association, AssociationProduct, Outputs, Place, Sensors, Shapes, Truths,
};

impl Registry {
    /// All methods of this project.
    pub fn standard() -> Self {
        Self::empty()
            .with(Method::<Sensors>::new(
                "images",
                "pictures of a folder or by a numbered pattern",
                sensor::images,
            ))
            .with(Method::<Shapes>::new("mesh", "parts from VRML 97, OBJ or CAO files", shape::mesh))
            .with(Method::<Appearances>::new("unknown", "nothing is known of the surface", unknown))
            .with(Method::<Truths>::new("tum", "poses by frame from a file", truth::tum))
            .with(Method::<Truths>::new("matrices", "a folder of 4x4 matrices", truth::matrices))
            .with(Method::<Truths>::new("simulated", "poses of a simulated sensor", truth::simulated))
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
                "pictures with model, measurements and state",
                output::overlays,
            ))
    }
}

fn unknown(_: NoParams, _: Place<'_>) -> Result<AppearanceProduct, ConfigError> {
    Ok(AppearanceProduct::Unknown)
}

fn one_to_one(_: NoParams, _: ()) -> Result<AssociationProduct, ConfigError> {
    Ok(AssociationProduct::OneToOne)
}
