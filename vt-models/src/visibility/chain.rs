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
    /// In the ideal image.
    pub direction: Vector2<f64>,
    /// In the object frame.
    pub tangent: Vector3<f64>,
}

/// A piece that deviates more from the course of its chain is part of a zigzag, as a cosine (8°).
const ZIGZAG: f64 = 0.99;

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
    fn at(&self, length: f64) -> Option<(Point2<f64>, Point3<f64>)> {
        let step = self.step(length)?;
        let line = &self.pieces[step.piece as usize].line;
        let t = ((length - step.start) / line.length).clamp(0.0, 1.0);
        let (ideal, _, p_in_object) = line.at(if step.forward { t } else { 1.0 - t });
        Some((ideal, p_in_object))
    }

    /// The piece at this length along the chain.
    fn step(&self, length: f64) -> Option<&Step> {
        self.walk.get(self.walk.partition_point(|s| s.start <= length).saturating_sub(1))
    }

    /// The middle of the piece at this length along the chain, with the chain's direction there. That is the direction
    /// of the piece, which on a regular polygon is that of the curve it stands for; where pieces go zigzag, it is
    /// the direction of the chord that reaches `reach` pixels to either side.
    pub fn place(&self, length: f64, reach: f64) -> Option<Place> {
        let step = self.step(length)?;
        let line = &self.pieces[step.piece as usize].line;
        let middle = step.start + 0.5 * line.length;
        let reach = reach.min(middle).min(self.length - middle);
        let (a, b) = (self.at(middle - reach)?, self.at(middle + reach)?);
        let chord = (b.0 - a.0).try_normalize(0.0)?;
        let own = if step.forward { line.direction } else { -line.direction };
        let (direction, tangent) = if own.dot(&chord) > ZIGZAG {
            let ends = [line.at(0.0).2, line.at(1.0).2];
            (own, (ends[1] - ends[0]) * if step.forward { 1.0 } else { -1.0 })
        } else {
            (chord, b.1 - a.1)
        };
        let (ideal, inverse_depth, p_in_object) = line.at(0.5);
        let tangent = tangent.try_normalize(0.0)?;
        Some(Place { piece: step.piece as usize, ideal, inverse_depth, p_in_object, direction, tangent })
    }
}
