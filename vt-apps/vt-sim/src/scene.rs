//! What there is to see: bodies on their paths, light and background.

use std::collections::BTreeMap;

use vt_models::mesh::{Mesh, Triangle};

use crate::backdrop::Background;
use crate::light::Lighting;
use crate::path::Path;
use crate::texture::{Skin, Texture};

/// A mesh with its looks.
pub struct Body {
    mesh: Mesh,
    texture: Texture,
    seed: u64,
    /// Looks of each triangle; `None` without area.
    skins: Vec<Option<Skin>>,
}

impl Body {
    /// A body; random looks depend on `seed`.
    pub fn new(mesh: Mesh, texture: Texture, seed: u64) -> Self {
        let planes = planes(&mesh);
        let skin = |t: &Triangle| {
            let plane = planes.get(t.polygon as usize).copied().flatten()?;
            texture.skin(seed, &mesh, t, plane)
        };
        let skins = mesh.triangles().iter().map(skin).collect();
        Self { mesh, texture, seed, skins }
    }

    /// The mesh.
    pub fn mesh(&self) -> &Mesh {
        &self.mesh
    }

    pub(crate) fn skins(&self) -> &[Option<Skin>] {
        &self.skins
    }

    pub(crate) fn texture(&self) -> &Texture {
        &self.texture
    }

    pub(crate) fn seed(&self) -> u64 {
        self.seed
    }
}

/// Number of each polygon's plane, two numbers apart; polygons of one plane that face the same way share one.
fn planes(mesh: &Mesh) -> Vec<Option<i64>> {
    let mut known = BTreeMap::new();
    let grain = 1e-3 * mesh.bounds().diagonal().max(f64::MIN_POSITIVE);
    let number = |k: usize| {
        let normal = mesh.normal(k)?;
        let corner = mesh.vertices().get(*mesh.polygons().get(k)?.corners.first()? as usize)?;
        let rounded = |v: f64| (v + 1e-7).round() as i64;
        let offset = (corner - mesh.bounds().center()).dot(&normal) / grain;
        let [x, y, z] = normal.map(|v| rounded(v * 1e3)).into();
        let key: [i64; 4] = [x, y, z, rounded(offset)];
        let next = 2 * known.len() as i64;
        Some(*known.entry(key).or_insert(next))
    };
    (0..mesh.polygons().len()).map(number).collect()
}

/// A body on its path.
pub struct Object {
    /// Name in reports.
    pub name: String,
    /// The body.
    pub body: Body,
    /// world_from_object over time.
    pub path: Path,
}

/// Everything that cameras see. Bodies hide each other; a body in front that is not tracked is an occluder.
pub struct World {
    /// The bodies.
    pub objects: Vec<Object>,
    /// The light.
    pub lighting: Lighting,
    /// What is behind all bodies. Each camera sees the same picture, wherever it stands.
    pub background: Background,
    /// Seed of the background.
    pub seed: u64,
}
