//! Skeleton of a skinned mesh, as model files bring it along.

use nalgebra::Matrix4;

/// A bone of a skeleton.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Authored name, possibly empty.
    pub name: String,
    /// The joint it hangs on; `None` at a root.
    pub parent: Option<u32>,
    /// Frame of the joint in the rest pose, in which the vertices of the mesh are given.
    pub object_from_joint: Matrix4<f64>,
    /// Maps a vertex in the rest pose into the frame of the joint (*inverse bind matrix*).
    pub joint_from_object: Matrix4<f64>,
}

/// How the vertices of a mesh follow its joints (linear blend skinning): under joints moved to
/// `object_from_joint'`, a vertex `v` with weights `w_j` lies at `Σ w_j · object_from_joint'_j · joint_from_object_j · v`.
#[derive(Clone, Debug, PartialEq, Default)]
pub struct Skin {
    /// The joints.
    pub joints: Vec<Joint>,
    /// Joint and weight, four for each vertex of the mesh; weights of a vertex that follows joints sum to 1, others
    /// have zeros only.
    pub weights: Vec<[(u32, f64); 4]>,
}

impl Skin {
    /// Changes the unit of length of all frames by this factor.
    pub fn scale(&mut self, factor: f64) {
        for joint in &mut self.joints {
            for matrix in [&mut joint.object_from_joint, &mut joint.joint_from_object] {
                (0..3).for_each(|row| matrix[(row, 3)] *= factor);
            }
        }
    }
}
