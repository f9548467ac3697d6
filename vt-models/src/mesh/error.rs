use super::{MeshData, Skin};

/// Farthest coordinate of a vertex, metres.
const FARTHEST: f64 = 1e12;

/// Most corners of a polygon.
const MAX_CORNERS: usize = 4096;

/// Why loose data is no mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Nothing to track.
    #[error("mesh is empty: found no polygon and no line, expected at least one")]
    Empty,
    /// A vertex is NaN, infinite, or so far away that squares of distances lose all meaning.
    #[error(
        "vertex {vertex} is not finite or far away: found ({x:e}, {y:e}, {z:e}), expected at most {FARTHEST:e} m"
    )]
    NotFinite {
        /// Vertex index.
        vertex: usize,
        /// Found x.
        x: f64,
        /// Found y.
        y: f64,
        /// Found z.
        z: f64,
    },
    /// All vertices lie in one point.
    #[error("mesh has no extent: found all {vertices} vertices in one point, expected at least two")]
    NoExtent {
        /// Number of vertices.
        vertices: usize,
    },
    /// A polygon with very many corners, which cannot be cut into triangles in good time.
    #[error("polygon {polygon} has {found} corners, expected at most {MAX_CORNERS}")]
    TooManyCorners {
        /// Polygon index.
        polygon: usize,
        /// Corners found.
        found: usize,
    },
    /// A reference points nowhere.
    #[error("{owner} {owner_index} refers to {what} {found}, expected an index below {limit}")]
    IndexOutOfRange {
        /// Kind of element that refers.
        owner: &'static str,
        /// Its index.
        owner_index: usize,
        /// Kind of element referred to.
        what: &'static str,
        /// The index found.
        found: u32,
        /// Number of elements there are.
        limit: usize,
    },
    /// A polygon with one or two corners.
    #[error("polygon {polygon} has {found} corners, expected at least 3")]
    TooFewCorners {
        /// Polygon index.
        polygon: usize,
        /// Corners found.
        found: usize,
    },
    /// Texture coordinates, colours or normals do not match the corners, or are not finite.
    #[error("polygon {polygon} has {found} finite {what} for {corners} corners, expected as many")]
    Corners {
        /// Polygon index.
        polygon: usize,
        /// What is given per corner.
        what: &'static str,
        /// Finite values found.
        found: usize,
        /// Corners.
        corners: usize,
    },
    /// The weights of a skin do not match the vertices, or a joint's frame is not finite.
    #[error("skin: found {found}, expected {expected}")]
    Skin {
        /// What is there.
        found: String,
        /// What should be there.
        expected: String,
    },
}

/// Checks that what a polygon has per corner is finite and complete.
fn check_corners<const N: usize>(
    polygon: usize,
    what: &'static str,
    values: Option<&Vec<[f32; N]>>,
    corners: usize,
) -> Result<(), MeshError> {
    let Some(values) = values else { return Ok(()) };
    let found = values.iter().filter(|c| c.iter().all(|x| x.is_finite())).count();
    if found == corners && values.len() == corners {
        Ok(())
    } else {
        Err(MeshError::Corners { polygon, what, found, corners })
    }
}

fn check_skin(skin: &Skin, vertices: usize) -> Result<(), MeshError> {
    let joints = skin.joints.len();
    let wrong = |found: String, expected: String| Err(MeshError::Skin { found, expected });
    if skin.weights.len() != vertices {
        return wrong(
            format!("weights of {} vertices", skin.weights.len()),
            format!("those of {vertices} vertices"),
        );
    }
    for (k, joint) in skin.joints.iter().enumerate() {
        let numbers = joint.object_from_joint.iter().chain(&joint.joint_from_object);
        if !numbers.into_iter().all(|v| v.is_finite()) {
            return wrong(format!("a frame of joint {k} that is not finite"), "finite numbers".into());
        }
        if joint.parent.is_some_and(|p| p as usize >= joints) {
            return wrong(
                format!("parent {:?} of joint {k}", joint.parent),
                format!("a joint below {joints}"),
            );
        }
    }
    match skin.weights.iter().flatten().find(|(j, w)| *j as usize >= joints || !w.is_finite()) {
        Some((j, w)) => {
            wrong(format!("weight {w} of joint {j}"), format!("a number and a joint below {joints}"))
        }
        None => Ok(()),
    }
}

/// Checks every index and number of the data.
pub(super) fn check(data: &MeshData) -> Result<(), MeshError> {
    if data.polygons.is_empty() && data.segments.is_empty() {
        return Err(MeshError::Empty);
    }
    for (vertex, p) in data.vertices.iter().enumerate() {
        if !p.iter().all(|c| c.abs() <= FARTHEST) {
            return Err(MeshError::NotFinite { vertex, x: p.x, y: p.y, z: p.z });
        }
    }
    let below = |owner, owner_index, what, found: u32, limit: usize| {
        if (found as usize) < limit {
            Ok(())
        } else {
            Err(MeshError::IndexOutOfRange { owner, owner_index, what, found, limit })
        }
    };
    for (i, polygon) in data.polygons.iter().enumerate() {
        let corners = polygon.corners.len();
        if corners < 3 {
            return Err(MeshError::TooFewCorners { polygon: i, found: corners });
        }
        if corners > MAX_CORNERS {
            return Err(MeshError::TooManyCorners { polygon: i, found: corners });
        }
        for &c in &polygon.corners {
            below("polygon", i, "vertex", c, data.vertices.len())?;
        }
        below("polygon", i, "part", polygon.part, data.parts.len())?;
        if let Some(m) = polygon.material {
            below("polygon", i, "material", m, data.materials.len())?;
        }
        check_corners(i, "texture coordinates", polygon.texcoords.as_ref(), corners)?;
        check_corners(i, "colours", polygon.colours.as_ref(), corners)?;
        check_corners(i, "normals", polygon.normals.as_ref(), corners)?;
    }
    for (i, segment) in data.segments.iter().enumerate() {
        for end in segment.ends {
            below("line", i, "vertex", end, data.vertices.len())?;
        }
        below("line", i, "part", segment.part, data.parts.len())?;
        if let Some(m) = segment.material {
            below("line", i, "material", m, data.materials.len())?;
        }
    }
    if data.vertices.windows(2).all(|p| p[0] == p[1]) {
        return Err(MeshError::NoExtent { vertices: data.vertices.len() });
    }
    data.skin.as_ref().map_or(Ok(()), |skin| check_skin(skin, data.vertices.len()))
}
