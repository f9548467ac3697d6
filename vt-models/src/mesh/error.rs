use super::MeshData;

/// Why loose data is no mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// Nothing to track.
    #[error("mesh is empty: found no polygon and no line, expected at least one")]
    Empty,
    /// A vertex is NaN or infinite.
    #[error("vertex {vertex} is not finite: found ({x}, {y}, {z}), expected three finite numbers")]
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
    /// Texture coordinates do not match the corners, or are not finite.
    #[error(
        "polygon {polygon} has {found} finite texture coordinates for {corners} corners, expected as many"
    )]
    Texcoords {
        /// Polygon index.
        polygon: usize,
        /// Finite coordinate pairs found.
        found: usize,
        /// Corners.
        corners: usize,
    },
}

/// Checks every index and number of the data.
pub(super) fn check(data: &MeshData) -> Result<(), MeshError> {
    if data.polygons.is_empty() && data.segments.is_empty() {
        return Err(MeshError::Empty);
    }
    for (vertex, p) in data.vertices.iter().enumerate() {
        if !p.iter().all(|c| c.is_finite()) {
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
        for &c in &polygon.corners {
            below("polygon", i, "vertex", c, data.vertices.len())?;
        }
        below("polygon", i, "part", polygon.part, data.parts.len())?;
        if let Some(m) = polygon.material {
            below("polygon", i, "material", m, data.materials.len())?;
        }
        if let Some(t) = &polygon.texcoords {
            let found = t.iter().filter(|c| c.iter().all(|x| x.is_finite())).count();
            if found != corners || t.len() != corners {
                return Err(MeshError::Texcoords { polygon: i, found, corners });
            }
        }
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
    Ok(())
}
