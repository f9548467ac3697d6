//! Which edges of a model can be seen from a pose, as sites along them.
//!
//! The mesh is rasterised at reduced resolution; edges are projected exactly and only *tested* against the raster,
//! so its half-pixel bias never reaches a position. Both happen in the *ideal* image, that of a pinhole with the same
//! focal lengths, where edges are straight; the pixels and weights of sites are those of the real one. A fisheye's edges
//! are seen up to 75° off the axis, and their sites lie denser in the picture the farther out they are.

mod ambiguity;
mod cache;
mod chain;
mod mesh_view;
mod projection;

pub(crate) use cache::ViewKey;
pub use cache::{ViewCache, ViewThresholds};
pub use mesh_view::MeshView;

use crate::camera::{Camera, Optics};
use crate::edges::{Edge, EdgeKind, EdgeModel};
use crate::mesh::Mesh;
use crate::raster::{RasterOptions, Rasterizer};
use chain::{Chains, Piece};
use nalgebra::{Point2, Point3, Vector2, Vector3};
use projection::{Span, View};
use vt_core::lie::SE3;

/// What kind of edge a site lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SiteKind {
    /// Fold of two surfaces.
    Crease,
    /// Rim of a surface.
    Boundary,
    /// Three or more surfaces.
    NonManifold,
    /// Line drawn by the author.
    Line,
    /// Silhouette of a smooth surface.
    Silhouette,
}

/// Side of a projected edge. With the image of the site's tangent `(tx, ty)`, u right and v down, the positive
/// normal is `(-ty, tx)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Side {
    /// Where the positive normal points.
    Positive,
    /// The other side.
    Negative,
}

/// A place on a visible edge where a tracker may search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EdgeSite {
    /// Position, object frame, metres.
    pub p_in_object: Point3<f64>,
    /// Unit direction of the edge, object frame.
    pub tangent: Vector3<f64>,
    /// Edge id; the smallest one of a chain.
    pub edge: u32,
    /// Kind of edge.
    pub kind: SiteKind,
    /// Unit normals of adjacent planes, object frame, signs as authored.
    pub normals: [Option<Vector3<f64>>; 2],
    /// Length of projected edge this site stands for, pixels.
    pub weight: f32,
    /// At an occluding contour, the side on which the object lies; the other shows background or a clearly
    /// farther surface.
    pub contour: Option<Side>,
    /// Another visible edge runs nearly parallel within a few pixels, or meets this one right beside the site.
    pub ambiguous: bool,
    /// Where it was seen when the list was made.
    pub pixel: Point2<f64>,
}

/// How to look for sites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VisibilityOptions {
    /// Distance between sites, pixels.
    pub step: f64,
    /// Size of the depth image relative to the camera image.
    pub raster_scale: f64,
    /// A site is hidden where the surface in front is nearer by more than this part of the depth.
    pub depth_bias: f64,
    /// A surface beside the edge is clearly farther by this part of the depth.
    pub contour_gap: f64,
    /// Rim of the image in which no site is placed, pixels.
    pub border: f64,
    /// Shorter projected edges get no sites of their own, pixels. Those that follow one another are linked to chains,
    /// of which only such that are shorter are skipped.
    pub min_length: f64,
    /// Distance of nearly parallel edges that makes them ambiguous, pixels.
    pub ambiguity: f64,
    /// Most sites; beyond it they are thinned evenly.
    pub max_sites: usize,
    /// Nearest depth seen, metres.
    pub near: f64,
}

impl Default for VisibilityOptions {
    fn default() -> Self {
        Self {
            step: 8.0,
            raster_scale: 0.5,
            depth_bias: 0.005,
            contour_gap: 0.02,
            border: 4.0,
            min_length: 4.0,
            ambiguity: 3.5,
            max_sites: 500,
            near: 1e-3,
        }
    }
}

/// Visible sites of one view, with the buffers to compute them again without allocation.
#[derive(Clone, Debug, Default)]
pub struct VisibleEdges {
    sites: Vec<EdgeSite>,
    ideal: Vec<Point2<f64>>,
    spans: Vec<Span>,
    order: Vec<u32>,
    raster: Rasterizer,
    frame: projection::Frame,
    chains: Chains,
    cut: bool,
}

/// A place on an edge that may become a site.
struct Candidate<'a> {
    edge: &'a Edge,
    id: u32,
    kind: SiteKind,
    ideal: Point2<f64>,
    inverse_depth: f64,
    p_in_object: Point3<f64>,
    tangent: Vector3<f64>,
    weight: f32,
}

impl View {
    /// Length in the picture per length in the ideal image along an edge; of interest where a fisheye makes it small.
    fn stretch(&self, camera: &Camera, at: &Candidate<'_>) -> f32 {
        if matches!(camera.optics(), Optics::Perspective(_)) {
            return 1.0;
        }
        let p_in_camera = self.camera_from_object.act(&at.p_in_object);
        let along = self.camera_from_object.rotation * at.tangent;
        let length = |c: &Camera| c.project_with_jacobian(&p_in_camera).map(|(_, j)| (j * along).norm());
        match (length(camera), length(&camera.without_lens())) {
            (Some(real), Some(ideal)) if ideal > 0.0 => (real / ideal) as f32,
            _ => 1.0,
        }
    }
}

impl VisibleEdges {
    /// Computes the sites visible from `camera_from_object`.
    pub fn update(
        &mut self,
        mesh: &Mesh,
        edges: &EdgeModel,
        camera: &Camera,
        camera_from_object: &SE3,
        options: &VisibilityOptions,
    ) {
        self.frame.update(camera);
        let raster = RasterOptions {
            scale: options.raster_scale,
            near: options.near,
            margin: self.frame.overhang(camera),
            whole_image: false,
        };
        self.raster.render(mesh, camera, camera_from_object, &raster);
        self.sites.clear();
        self.ideal.clear();
        self.spans.clear();
        self.cut = false;
        // Sites are thinned only at the end; a view rarely has more than twice the budget before that.
        self.sites.reserve(2 * options.max_sites);
        self.ideal.reserve(2 * options.max_sites);
        self.spans.reserve(edges.edges().len());
        self.order.clear();
        self.order.reserve(edges.edges().len());
        self.chains.clear(edges.edges().len(), edges.joint_count());
        let view = View::new(camera, camera_from_object, options.near);
        for (id, edge) in edges.edges().iter().enumerate() {
            self.edge(id as u32, edge, edges.joints(id), &view, camera, options);
        }
        while self.chains.advance() {
            self.chain(edges, &view, camera, options);
        }
        ambiguity::mark(&mut self.sites, &self.ideal, &self.spans, &mut self.order, options.ambiguity);
        self.thin(options.max_sites);
    }

    fn edge(
        &mut self,
        id: u32,
        edge: &Edge,
        joints: [u32; 2],
        view: &View,
        camera: &Camera,
        options: &VisibilityOptions,
    ) {
        let kind = match edge.kind {
            EdgeKind::Crease => SiteKind::Crease,
            EdgeKind::Boundary => SiteKind::Boundary,
            EdgeKind::NonManifold => SiteKind::NonManifold,
            EdgeKind::Line => SiteKind::Line,
            EdgeKind::Smooth if view.is_silhouette(edge) => SiteKind::Silhouette,
            EdgeKind::Smooth => return,
        };
        let mut cut = false;
        let line = view.project(edge, self.frame.bounds(), &mut cut);
        self.cut |= cut;
        let Some(line) = line else { return };
        if line.length < options.min_length {
            // The end of a cut edge is no joint.
            if !cut {
                self.chains.push(Piece { edge: id, kind, line, joints });
            }
            return;
        }
        let (_, middle_depth, middle) = line.at(0.5);
        let across = line.normal();
        let covered = view.covered_sides(edge, middle_depth, &middle, &across);
        let n = ((line.length / options.step).round() as usize).clamp(1, options.max_sites.max(1));
        let first = self.sites.len();
        let weight = (line.length / n as f64) as f32;
        let tangent = edge.direction();
        for k in 0..n {
            let (ideal, inverse_depth, p_in_object) = line.at((k as f64 + 0.5) / n as f64);
            let candidate = Candidate { edge, id, kind, ideal, inverse_depth, p_in_object, tangent, weight };
            self.site(&candidate, &across, covered, view, camera, options);
        }
        if self.sites.len() > first {
            self.spans.push(Span::new(&line, first as u32, self.sites.len() as u32));
        }
    }

    /// Sites along the chain of short edges that was walked last.
    fn chain(&mut self, edges: &EdgeModel, view: &View, camera: &Camera, options: &VisibilityOptions) {
        let length = self.chains.length();
        if length < options.min_length {
            return;
        }
        let id = self.chains.id();
        let n = ((length / options.step).round() as usize).clamp(1, options.max_sites.max(1));
        let share = length / n as f64;
        for k in 0..n {
            let at = (k as f64 + 0.5) * share;
            let Some(place) = self.chains.place(at, 0.5 * share) else { continue };
            let piece = self.chains.piece(place.piece);
            let Some(edge) = edges.edges().get(piece.edge as usize) else { continue };
            let chain::Place { ideal, inverse_depth, p_in_object, direction, tangent, .. } = place;
            let kind = piece.kind;
            let across = quarter_turn(&direction);
            // Across the chord a slanting edge would take the wrong side; its own sides tell which is which.
            let own = piece.line.normal();
            let own = if own.dot(&across) < 0.0 { -own } else { own };
            let covered = view.covered_sides(edge, inverse_depth, &p_in_object, &own);
            let weight = share as f32;
            let candidate = Candidate { edge, id, kind, ideal, inverse_depth, p_in_object, tangent, weight };
            if self.site(&candidate, &across, covered, view, camera, options) {
                self.spans.push(Span::about(&ideal, direction, share, self.sites.len() as u32 - 1));
            }
        }
    }

    /// Adds the site unless it is hidden or outside the picture. `across` is the positive normal, `covered` says on
    /// which sides of it (positive, negative) the edge's own surfaces lie.
    fn site(
        &mut self,
        at: &Candidate<'_>,
        across: &Vector2<f64>,
        covered: [bool; 2],
        view: &View,
        camera: &Camera,
        options: &VisibilityOptions,
    ) -> bool {
        let in_buffer = self.raster.viewport().buffer_from_image(&at.ideal);
        let seen = |offset: f64| f64::from(self.raster.inverse_depth_at(&(in_buffer + across * offset)));
        let limit = at.inverse_depth * (1.0 + options.depth_bias);
        if [0.0, 1.0, -1.0].iter().all(|&offset| seen(offset) > limit) {
            return false;
        }
        let pixel = camera.project(&view.camera_from_object.act(&at.p_in_object));
        let Some(pixel) = pixel.filter(|p| camera.contains(p, -options.border)) else { return false };
        // The edge's own surface may fall off steeply; a side it covers is never "farther".
        let far = |side: usize, offset: f64| {
            !covered[side] && seen(offset) < at.inverse_depth * (1.0 - options.contour_gap)
        };
        let contour = match (far(0, 1.5), far(1, -1.5)) {
            (true, false) => Some(Side::Negative),
            (false, true) => Some(Side::Positive),
            _ => None,
        };
        self.ideal.push(at.ideal);
        self.sites.push(EdgeSite {
            p_in_object: at.p_in_object,
            tangent: at.tangent,
            edge: at.id,
            kind: at.kind,
            normals: [0, 1].map(|i| at.edge.sheets.get(i).map(|s| s.normal)),
            weight: at.weight * view.stretch(camera, at),
            contour,
            ambiguous: false,
            pixel,
        });
        true
    }

    /// Keeps `max` sites, evenly, and gives them the weight of the others.
    fn thin(&mut self, max: usize) {
        let n = self.sites.len();
        if n <= max {
            return;
        }
        let mut index = 0;
        self.sites.retain(|_| {
            let keep = index * max / n != (index + 1) * max / n;
            index += 1;
            keep
        });
        let factor = n as f32 / max.max(1) as f32;
        self.sites.iter_mut().for_each(|s| s.weight *= factor);
    }

    /// The visible sites, in edge order, then those of chains.
    #[must_use]
    pub fn sites(&self) -> &[EdgeSite] {
        &self.sites
    }

    /// Whether some edge reached beyond the image or the near plane.
    #[must_use]
    pub fn is_cut(&self) -> bool {
        self.cut
    }

    /// The depth image the sites were tested against.
    #[must_use]
    pub fn raster(&self) -> &Rasterizer {
        &self.raster
    }
}

/// `(-y, x)`: a quarter turn from u to v.
fn quarter_turn(d: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-d.y, d.x)
}

#[cfg(test)]
mod tests;
