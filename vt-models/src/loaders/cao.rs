//! ViSP CAO, version 1: points, lines, faces, cylinders and circles in a line-oriented text.

use super::primitives::{circle, frustum};
use super::{LoadError, Loader, MAX_ELEMENTS, finish, read};
use crate::mesh::{Mesh, MeshData, Polygon, Segment, Unit};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit as Direction, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};

/// Reader of `.cao` files.
///
/// Sections in order, each a count and that many lines: points, lines (two points), faces from lines, faces from
/// points, cylinders (two points of the axis, radius; read as closed solids), circles (radius, centre, two points
/// of the plane; read as lines). The last two may be missing. Lines that a face uses are not explicit lines. Of the
/// trailing options `name=` names the polygon; the others tune ViSP's level of detail and are checked for form only.
/// `load("file", t=[x; y; z], tu=[θx; θy; θz])` includes a file, relative to the including one; the translation is
/// in the file's unit, angles in radians or with the suffix `deg`. Each file is a part.
pub struct CaoLoader;

impl Loader for CaoLoader {
    fn extensions(&self) -> &'static [&'static str] {
        &["cao"]
    }

    fn load(&self, path: &Path, unit: Unit) -> Result<Mesh, LoadError> {
        let mut data = MeshData::default();
        include(path, &Isometry3::identity(), &mut data, &mut Vec::new())?;
        finish(data, path, unit)
    }
}

const OPTIONS: [&str; 4] = ["name", "useLod", "minLineLengthThreshold", "minPolygonAreaThreshold"];
/// Deepest chain of includes.
const MAX_INCLUDES: usize = 64;
/// Most files in all, against includes that multiply.
const MAX_FILES: usize = 1000;

/// Lines without comments, numbered from 1.
struct Rows<'a> {
    file: &'a Path,
    rows: Vec<(usize, &'a str)>,
    at: usize,
}

/// One data line: leading numbers, then `key=value` options.
struct Row<'a> {
    file: &'a Path,
    line: usize,
    numbers: Vec<&'a str>,
    name: Option<String>,
}

impl<'a> Rows<'a> {
    fn new(file: &'a Path, text: &'a str) -> Self {
        let strip = |(i, row): (usize, &'a str)| (i + 1, row.split('#').next().unwrap_or_default().trim());
        Self { file, rows: text.lines().enumerate().map(strip).filter(|r| !r.1.is_empty()).collect(), at: 0 }
    }

    fn peek(&self) -> Option<(usize, &'a str)> {
        self.rows.get(self.at).copied()
    }

    fn next(&mut self, expected: &str) -> Result<(usize, &'a str), LoadError> {
        let end = self.rows.last().map_or(1, |r| r.0);
        let row =
            self.peek().ok_or_else(|| LoadError::syntax(self.file, end, "the end of the file", expected));
        self.at += 1;
        row
    }

    /// The count that opens a section.
    fn count(&mut self, section: &str) -> Result<usize, LoadError> {
        let expected = format!("the number of {section}");
        let (line, text) = self.next(&expected)?;
        let word = text.split_whitespace().next().unwrap_or_default();
        word.parse().map_err(|_| LoadError::syntax(self.file, line, format!("`{word}`"), expected))
    }

    fn row(&mut self, expected: &str) -> Result<Row<'a>, LoadError> {
        let (line, text) = self.next(expected)?;
        let mut row = Row { file: self.file, line, numbers: Vec::new(), name: None };
        let mut options = false;
        for word in text.split_whitespace() {
            match word.split_once('=') {
                Some((key, value)) if OPTIONS.contains(&key) => {
                    options = true;
                    if key == "name" {
                        row.name = Some(value.trim_matches('"').to_owned());
                    }
                }
                Some((key, _)) => {
                    let known = OPTIONS.map(|o| format!("{o}=")).join(", ");
                    return Err(LoadError::syntax(self.file, line, format!("the option `{key}=`"), known));
                }
                // Words after the first option belong to a value with blanks.
                None if options => {}
                None => row.numbers.push(word),
            }
        }
        Ok(row)
    }
}

impl Row<'_> {
    fn word(&self, i: usize, expected: &str) -> Result<&str, LoadError> {
        let found =
            || LoadError::syntax(self.file, self.line, format!("{} numbers", self.numbers.len()), expected);
        self.numbers.get(i).copied().ok_or_else(found)
    }

    fn number(&self, i: usize, expected: &str) -> Result<f64, LoadError> {
        let word = self.word(i, expected)?;
        let number = word.parse().ok().filter(|x: &f64| x.is_finite());
        number.ok_or_else(|| LoadError::syntax(self.file, self.line, format!("`{word}`"), expected))
    }

    fn index(&self, i: usize, limit: usize, what: &str) -> Result<usize, LoadError> {
        let expected = format!("the index of a {what} below {limit}");
        let word = self.word(i, &expected)?;
        let index = word.parse().ok().filter(|&k: &usize| k < limit);
        index.ok_or_else(|| LoadError::syntax(self.file, self.line, format!("`{word}`"), expected))
    }

    /// A count of at least `least`, followed by that many indices.
    fn indices(&self, limit: usize, what: &str, least: usize) -> Result<Vec<usize>, LoadError> {
        let expected = format!("a count of at least {least} and that many indices of a {what}");
        let word = self.word(0, &expected)?;
        let n = word.parse().ok().filter(|&n: &usize| n >= least && n < self.numbers.len());
        let n = n.ok_or_else(|| {
            let found = format!("the count `{word}` and {} indices", self.numbers.len() - 1);
            LoadError::syntax(self.file, self.line, found, expected)
        })?;
        (1..=n).map(|i| self.index(i, limit, what)).collect()
    }

    fn radius(&self, i: usize) -> Result<f64, LoadError> {
        let expected = "a positive radius";
        let radius = self.number(i, expected)?;
        if radius > 0.0 { Ok(radius) } else { Err(self.wrong(format!("`{radius}`"), expected)) }
    }

    fn wrong(&self, found: impl Into<String>, expected: &str) -> LoadError {
        LoadError::syntax(self.file, self.line, found, expected)
    }
}

fn include(
    path: &Path,
    object_from_file: &Isometry3<f64>,
    data: &mut MeshData,
    open: &mut Vec<PathBuf>,
) -> Result<(), LoadError> {
    let bytes = read(path)?;
    let identity = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    open.push(identity);
    let text = String::from_utf8_lossy(&bytes);
    let mut rows = Rows::new(path, &text);
    let (line, version) = rows.next("the version `V1`")?;
    if version != "V1" {
        return Err(LoadError::syntax(path, line, format!("`{version}`"), "the version `V1`"));
    }
    while let Some((line, text)) = rows.peek().filter(|r| r.1.starts_with("load")) {
        rows.at += 1;
        let (name, file_from_part) = load_line(path, line, text)?;
        let target = path.parent().unwrap_or(Path::new("")).join(name);
        let identity = std::fs::canonicalize(&target)
            .map_err(|e| LoadError::syntax(path, line, format!("`{name}` ({e})"), "an existing file"))?;
        if open.contains(&identity) || open.len() >= MAX_INCLUDES {
            let chain = format!("`{name}`, which is being loaded already or the {MAX_INCLUDES}th in a chain");
            return Err(LoadError::syntax(path, line, chain, "no cyclic include"));
        }
        let elements = data.vertices.len() + data.polygons.len() + data.segments.len();
        if data.parts.len() >= MAX_FILES || elements > MAX_ELEMENTS {
            let found =
                format!("{} files with {elements} points, polygons and lines before", data.parts.len());
            let expected = format!("at most {MAX_FILES} files and {MAX_ELEMENTS} elements");
            return Err(LoadError::syntax(path, line, found, expected));
        }
        include(&target, &(object_from_file * file_from_part), data, open)?;
    }
    let part = data.parts.len() as u32;
    data.parts.push(path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default());
    sections(&mut rows, object_from_file, data, part)?;
    open.pop();
    Ok(())
}

fn sections(
    rows: &mut Rows,
    frame: &Isometry3<f64>,
    data: &mut MeshData,
    part: u32,
) -> Result<(), LoadError> {
    let base = data.vertices.len();
    let n = rows.count("points")?;
    for _ in 0..n {
        let expected = "three coordinates of a point";
        let row = rows.row(expected)?;
        let p = Point3::new(row.number(0, expected)?, row.number(1, expected)?, row.number(2, expected)?);
        data.vertices.push(frame * p);
    }
    let vertex = |i: usize| (base + i) as u32;

    let mut lines = Vec::new();
    for _ in 0..rows.count("lines")? {
        let row = rows.row("two point indices of a line")?;
        lines.push([row.index(0, n, "point")?, row.index(1, n, "point")?]);
    }
    let mut used = vec![false; lines.len()];
    for _ in 0..rows.count("faces from lines")? {
        let row = rows.row("a face from lines")?;
        let indices = row.indices(lines.len(), "line", 3)?;
        let sides: Vec<[usize; 2]> = indices.iter().map(|&i| lines[i]).collect();
        indices.iter().for_each(|&i| used[i] = true);
        let corners = outline(&sides).ok_or_else(|| {
            row.wrong(format!("lines {indices:?}"), "lines that form a closed outline in order")
        })?;
        let corners = corners.into_iter().map(vertex).collect();
        data.polygons.push(Polygon { corners, part, name: row.name, ..Default::default() });
    }
    let free = lines.iter().zip(used).filter(|l| !l.1);
    data.segments.extend(free.map(|(l, _)| Segment { ends: l.map(vertex), material: None, part }));

    for _ in 0..rows.count("faces from points")? {
        let row = rows.row("a face from points")?;
        let corners = row.indices(n, "point", 3)?.into_iter().map(vertex).collect();
        data.polygons.push(Polygon { corners, part, name: row.name, ..Default::default() });
    }

    let cylinders = if rows.peek().is_some() { rows.count("cylinders")? } else { 0 };
    for _ in 0..cylinders {
        let row = rows.row("two point indices and the radius of a cylinder")?;
        let a = data.vertices[base + row.index(0, n, "point")?];
        let b = data.vertices[base + row.index(1, n, "point")?];
        let radius = row.radius(2)?;
        let axis = b - a;
        let height = axis.norm();
        if height == 0.0 {
            return Err(row.wrong("an axis of length 0", "two different points on the axis"));
        }
        let turn = Rotation3::rotation_between(&Vector3::y(), &axis)
            .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI));
        let center = nalgebra::center(&a, &b);
        let solid = frustum(radius, radius, height, [true; 2], true);
        let first = data.vertices.len() as u32;
        data.vertices.extend(solid.points.iter().map(|p| center + turn * p.coords));
        data.polygons.extend(solid.polygons.into_iter().map(|mut corners| {
            corners.iter_mut().for_each(|c| *c += first);
            Polygon { corners, part, name: row.name.clone(), ..Default::default() }
        }));
    }

    let circles = if rows.peek().is_some() { rows.count("circles")? } else { 0 };
    for _ in 0..circles {
        let row = rows.row("the radius and three point indices of a circle")?;
        let radius = row.radius(0)?;
        let center = data.vertices[base + row.index(1, n, "point")?];
        let a = data.vertices[base + row.index(2, n, "point")?];
        let b = data.vertices[base + row.index(3, n, "point")?];
        let normal = Direction::try_new((a - center).cross(&(b - center)), 0.0).ok_or_else(|| {
            row.wrong("three points on a line", "a centre and two points that span the plane")
        })?;
        let first = data.vertices.len() as u32;
        let points = circle(center, normal, radius);
        let count = points.len() as u32;
        data.vertices.extend(points);
        let side = |i| Segment { ends: [first + i, first + (i + 1) % count], material: None, part };
        data.segments.extend((0..count).map(side));
    }
    match rows.peek() {
        Some((line, text)) => {
            Err(LoadError::syntax(rows.file, line, format!("`{text}`"), "the end of the file"))
        }
        None => Ok(()),
    }
}

/// Corners of a closed chain of sides, each in either direction.
fn outline(sides: &[[usize; 2]]) -> Option<Vec<usize>> {
    let [a, b] = *sides.first()?;
    let start = if sides.get(1)?.contains(&b) { a } else { b };
    let mut corners = Vec::with_capacity(sides.len());
    let mut at = start;
    for &[a, b] in sides {
        corners.push(at);
        at = if a == at {
            b
        } else if b == at {
            a
        } else {
            return None;
        };
    }
    (at == start).then_some(corners)
}

/// `load("name")` or `load("name", t=[..], tu=[..])`.
fn load_line<'a>(file: &Path, line: usize, text: &'a str) -> Result<(&'a str, Isometry3<f64>), LoadError> {
    let expected = "load(\"file.cao\", t=[x; y; z], tu=[x; y; z])";
    let wrong = || LoadError::syntax(file, line, format!("`{text}`"), expected);
    let inner = text.strip_prefix("load").map(str::trim).and_then(|t| t.strip_prefix('(')?.strip_suffix(')'));
    let (name, mut rest) = inner
        .ok_or_else(wrong)?
        .trim()
        .strip_prefix('"')
        .and_then(|t| t.split_once('"'))
        .ok_or_else(wrong)?;
    let mut pose = Isometry3::identity();
    loop {
        rest = rest.trim().trim_start_matches(',').trim_start();
        if rest.is_empty() {
            return Ok((name, pose));
        }
        let (key, list) = rest.split_once('=').ok_or_else(wrong)?;
        let (list, after) =
            list.trim().strip_prefix('[').and_then(|l| l.split_once(']')).ok_or_else(wrong)?;
        let mut v = Vec::new();
        for word in list.split([';', ',', ' ', '\t']).filter(|w| !w.is_empty()) {
            let (digits, factor) = match word.strip_suffix("deg") {
                Some(digits) => (digits, std::f64::consts::PI / 180.0),
                None => (word, 1.0),
            };
            v.push(digits.parse().ok().filter(|x: &f64| x.is_finite()).ok_or_else(wrong)? * factor);
        }
        let [x, y, z] = v[..] else { return Err(wrong()) };
        match key.trim() {
            "t" => pose.translation = Translation3::new(x, y, z),
            "tu" => pose.rotation = UnitQuaternion::from_scaled_axis(Vector3::new(x, y, z)),
            _ => return Err(wrong()),
        }
        rest = after;
    }
}
