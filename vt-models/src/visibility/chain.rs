use super::SiteKind;
use super::projection::Line;
use nalgebra::{Point2, Point3, Vector2, Vector3};

/// A visible edge that is too short in the image for a site of its own.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    pub edge: u32,
    pub kind: SiteKind,
    pub line: Line,
    /// Ends in the edge model, in the order of the line.
    pub joints: [u32; 2],
}

/// Links pieces that follow one another into chains, so that a finely tessellated contour carries sites at the usual
/// spacing. Its buffers grow to the number of edges once.
#[derive(Clone, Debug, Default)]
pub(super) struct Chains {
    pieces: Vec<Piece>,
    used: Vec<bool>,
    /// Pieces at each joint; where there are more than fit, chains end.
    meetings: Vec<Meeting>,
    walk: Vec<Step>,
    length: f64,
    /// No piece before this one is unused.
    next: usize,
}

#[derive(Clone, Copy, Debug, Default)]
struct Meeting {
    count: u8,
    pieces: [u32; 4],
}

/// A piece in a chain, from where along the chain it lies, and whether the chain runs along its line.
#[derive(Clone, Copy, Debug)]
struct Step {
    piece: u32,
    forward: bool,
    start: f64,
}

/// A place on a chain.
pub(super) struct Place {
    pub piece: usize,
    pub ideal: Point2<f64>,
    pub inverse_depth: f64,
    pub p_in_object: Point3<f64>,
}

/// Largest bend from one piece to the next, as a cosine (60°): beyond it lies a corner.
const BEND: f64 = 0.5;

impl Chains {
    /// Forgets the pieces of the last view and makes room for those of a model.
    pub fn clear(&mut self, edges: usize, joints: usize) {
        for piece in &self.pieces {
            for joint in piece.joints {
                self.meetings[joint as usize] = Meeting::default();
            }
        }
        self.pieces.clear();
        self.pieces.reserve(edges);
        self.next = 0;
        self.used.clear();
        self.used.reserve(edges);
        self.walk.clear();
        self.walk.reserve(edges);
        // Another model than last time may have fewer joints; those left are clear.
        self.meetings.resize(joints, Meeting::default());
    }

    pub fn push(&mut self, piece: Piece) {
        for joint in piece.joints {
            let meeting = &mut self.meetings[joint as usize];
            if let Some(slot) = meeting.pieces.get_mut(usize::from(meeting.count)) {
                *slot = self.pieces.len() as u32;
            }
            meeting.count = meeting.count.saturating_add(1);
        }
        self.pieces.push(piece);
        self.used.push(false);
    }

    pub fn piece(&self, index: usize) -> &Piece {
        &self.pieces[index]
    }

    /// Walks along the next chain; false when all pieces are used.
    pub fn advance(&mut self) -> bool {
        let rest = self.used.get(self.next..).unwrap_or_default();
        let Some(first) = rest.iter().position(|u| !u).map(|i| i + self.next) else { return false };
        self.next = first + 1;
        self.walk.clear();
        self.extend(first, false);
        // What lies behind the first piece was found walking away from it.
        self.walk.reverse();
        self.walk.iter_mut().for_each(|s| s.forward = !s.forward);
        if let Some((piece, forward)) = self.follow(first, true) {
            self.extend(piece, forward);
        }
        self.length = 0.0;
        for step in &mut self.walk {
            step.start = self.length;
            self.length += self.pieces[step.piece as usize].line.length;
        }
        true
    }

    /// Appends a piece and all that follow it.
    fn extend(&mut self, piece: usize, forward: bool) {
        let mut next = Some((piece, forward));
        while let Some((piece, forward)) = next {
            self.used[piece] = true;
            self.walk.push(Step { piece: piece as u32, forward, start: 0.0 });
            next = self.follow(piece, forward);
        }
    }

    /// The unused piece of the same kind that continues this one best, with the direction in which it is walked.
    fn follow(&self, piece: usize, forward: bool) -> Option<(usize, bool)> {
        let here = &self.pieces[piece];
        let joint = here.joints[usize::from(forward)];
        let ahead = if forward { here.line.direction } else { -here.line.direction };
        let meeting = self.meetings.get(joint as usize)?;
        let others = meeting.pieces.get(..usize::from(meeting.count))?;
        let mut best: Option<(f64, usize, bool)> = None;
        for &other in others {
            let there = &self.pieces[other as usize];
            if self.used[other as usize] || there.kind != here.kind {
                continue;
            }
            let forward = there.joints[0] == joint;
            let along = ahead.dot(&there.line.direction) * if forward { 1.0 } else { -1.0 };
            if along >= BEND && best.is_none_or(|b| along > b.0) {
                best = Some((along, other as usize, forward));
            }
        }
        best.map(|b| (b.1, b.2))
    }

    /// Length of the chain in the image, pixels.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Smallest edge id on the chain: its name, whatever end it is walked from.
    pub fn id(&self) -> u32 {
        self.walk.iter().map(|s| self.pieces[s.piece as usize].edge).min().unwrap_or_default()
    }

    /// The place at this length along the chain.
    pub fn at(&self, length: f64) -> Option<Place> {
        let index = self.walk.partition_point(|s| s.start <= length).saturating_sub(1);
        let step = self.walk.get(index)?;
        let line = &self.pieces[step.piece as usize].line;
        let t = ((length - step.start) / line.length).clamp(0.0, 1.0);
        let (ideal, inverse_depth, p_in_object) = line.at(if step.forward { t } else { 1.0 - t });
        Some(Place { piece: step.piece as usize, ideal, inverse_depth, p_in_object })
    }

    /// Direction of the chain over `reach` pixels to either side of a place, in the image and in the object.
    pub fn chord(&self, length: f64, reach: f64) -> Option<(Vector2<f64>, Vector3<f64>)> {
        let (a, b) = (self.at(length - reach)?, self.at(length + reach)?);
        let image = (b.ideal - a.ideal).try_normalize(0.0)?;
        Some((image, (b.p_in_object - a.p_in_object).try_normalize(0.0)?))
    }
}
