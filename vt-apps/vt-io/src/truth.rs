//! True poses by frame number, for scores and for the start of a run.

use std::collections::BTreeMap;
use std::path::Path;

use nalgebra::{Matrix3, Matrix6, Point2, Quaternion, Rotation3, UnitQuaternion, Vector3};
use vt_core::error::DeviceError;
use vt_core::file::MOST;
use vt_core::lie::SE3;
use vt_core::manifold::Coordinates;

use crate::boxes::Corners;

/// What is true of a target, by frame number.
#[derive(Clone, Debug, Default)]
pub struct Truth {
    /// Poses of a body, camera_from_object in metres.
    pub poses: BTreeMap<u64, SE3>,
    /// Images of the corners of a flat shape's bounds, in order around them, pixels.
    pub corners: BTreeMap<u64, Corners>,
}

impl Truth {
    /// That of a body.
    pub fn of_poses(poses: BTreeMap<u64, SE3>) -> Self {
        Self { poses, ..Self::default() }
    }

    /// That of a flat shape.
    pub fn of_corners(corners: BTreeMap<u64, Corners>) -> Self {
        Self { corners, ..Self::default() }
    }

    /// Reads `x y width height` lines, a box a frame from the number `first` on: `(x, y)` is its first pixel.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file and the line.
    pub fn read_boxes(path: &Path, first: u64) -> Result<Self, DeviceError> {
        let corners = |v: &[f64]| {
            // Pixels have their centre at whole coordinates, their borders half a pixel off.
            let (x, y, right, bottom) = (v[0] - 0.5, v[1] - 0.5, v[0] + v[2] - 0.5, v[1] + v[3] - 0.5);
            [(x, y), (right, y), (right, bottom), (x, bottom)].map(|(x, y)| Point2::new(x, y))
        };
        Self::read_planar(path, first, "x y width height", 4, corners)
    }

    /// Reads `x1 y1 x2 y2 x3 y3 x4 y4` lines, the corners of a frame from the number `first` on, whole numbers at pixel centres.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file and the line.
    pub fn read_corners(path: &Path, first: u64) -> Result<Self, DeviceError> {
        let corners = |v: &[f64]| core::array::from_fn(|k| Point2::new(v[2 * k], v[2 * k + 1]));
        Self::read_planar(path, first, "x1 y1 x2 y2 x3 y3 x4 y4", 8, corners)
    }

    /// Lines of `n` numbers, called `what`; those that are not finite say that a frame has no truth.
    fn read_planar(
        path: &Path,
        first: u64,
        what: &str,
        n: usize,
        corners: impl Fn(&[f64]) -> Corners,
    ) -> Result<Self, DeviceError> {
        let mut out = BTreeMap::new();
        for (frame, (line, v)) in (first..).zip(numbers(path)?) {
            if v.len() != n {
                let why = format!("line {line}: {} numbers; expected {n}: {what}", v.len());
                return Err(DeviceError::new(path.display(), why));
            }
            if v.iter().all(|v| v.is_finite()) {
                out.insert(frame, corners(&v));
            }
        }
        if out.is_empty() {
            return Err(DeviceError::new(path.display(), format!("no frames; expected lines of {what}")));
        }
        Ok(Self::of_corners(out))
    }

    /// Reads `frame tx ty tz qx qy qz qw` lines (blanks or commas between the numbers, `#` starts a comment).
    ///
    /// # Errors
    /// [`DeviceError`] that names the file and the line; a frame with two different poses is an error.
    pub fn read_tum(path: &Path) -> Result<Self, DeviceError> {
        let mut poses = BTreeMap::new();
        for (line, v) in rows(path)? {
            let frame = numbered(path, line, &v, "tx ty tz qx qy qz qw", 7)?;
            let fail = |why: String| DeviceError::new(path.display(), format!("line {line}: {why}"));
            let length = || v[4..].iter().map(|q| q * q).sum::<f64>().sqrt();
            let pose = from_quaternion(&v[1..])
                .ok_or_else(|| fail(format!("a quaternion of length {}; expected 1", length())))?;
            // Pictures that are played to and fro have their pose twice.
            if poses.insert(frame, pose).is_some_and(|before| before != pose) {
                return Err(fail(format!("another pose of frame {frame}; expected one")));
            }
        }
        Ok(Self::of_poses(poses))
    }

    /// Reads a folder of text files with a 4×4 matrix each; the last number of a file's name is its frame.
    ///
    /// # Errors
    /// [`DeviceError`] that names the file.
    pub fn read_matrices(folder: &Path) -> Result<Self, DeviceError> {
        let fail = |e: std::io::Error| DeviceError::new(folder.display(), e);
        let mut poses = BTreeMap::new();
        for entry in std::fs::read_dir(folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default();
            let digits = stem.rsplit(|c: char| !c.is_ascii_digit()).find(|s| !s.is_empty());
            let number = digits.and_then(|d| d.parse().ok());
            if let (Some(n), true) = (number, path.extension().is_some_and(|e| e == "txt"))
                && poses.insert(n, read_pose(&path)?).is_some()
            {
                let why = format!("second pose of frame {n}; expected one");
                return Err(DeviceError::new(path.display(), why));
            }
        }
        if poses.is_empty() {
            let why = "no poses; expected text files with a number in the name and a 4x4 matrix inside";
            return Err(DeviceError::new(folder.display(), why));
        }
        Ok(Self::of_poses(poses))
    }
}

/// Estimates by frame number, from a file or a folder as for [`Truth`]; `None` where a frame has no pose: a number that is
/// not finite, or a quaternion of zero. Quaternions of any other length are normalised.
///
/// # Errors
/// [`DeviceError`] that names the file and the line; a frame that comes twice is an error.
pub fn read_estimates(path: &Path) -> Result<BTreeMap<u64, Option<SE3>>, DeviceError> {
    if path.is_dir() {
        let poses = Truth::read_matrices(path)?.poses;
        return Ok(poses.into_iter().map(|(frame, pose)| (frame, Some(pose))).collect());
    }
    let mut estimates = BTreeMap::new();
    for (line, v) in numbers(path)? {
        let frame = numbered(path, line, &v, "tx ty tz qx qy qz qw", 7)?;
        if estimates.insert(frame, SE3::read(&v[1..])).is_some() {
            return Err(DeviceError::new(
                path.display(),
                format!("line {line}: second pose of frame {frame}; expected one"),
            ));
        }
    }
    Ok(estimates)
}

/// Covariances by frame number with their line: 21 values, the upper triangle by rows, translation before rotation, of
/// the error `log(estimate⁻¹ truth)`.
///
/// # Errors
/// [`DeviceError`] that names the file and the line.
pub fn read_covariances(path: &Path) -> Result<Vec<(usize, u64, Matrix6<f64>)>, DeviceError> {
    let mut out = vec![];
    for (line, v) in rows(path)? {
        let frame = numbered(path, line, &v, "21 values of a covariance", 21)?;
        let mut values = v.iter().skip(1);
        let mut covariance = Matrix6::zeros();
        for r in 0..6 {
            for c in r..6 {
                let value = values.next().copied().unwrap_or_default();
                covariance[(r, c)] = value;
                covariance[(c, r)] = value;
            }
        }
        out.push((line, frame, covariance));
    }
    Ok(out)
}

/// The frame number of a row that has `n` more numbers, called `rest`.
fn numbered(path: &Path, line: usize, row: &[f64], rest: &str, n: usize) -> Result<u64, DeviceError> {
    let fail = |why: String| DeviceError::new(path.display(), format!("line {line}: {why}"));
    if row.len() != n + 1 {
        return Err(fail(format!("{} numbers; expected {}: frame {rest}", row.len(), n + 1)));
    }
    match row[0] {
        // From 2^53, some 9.007e15, on there are gaps between the numbers.
        frame if (0.0..9e15).contains(&frame) && frame.fract() == 0.0 => Ok(frame as u64),
        frame => Err(fail(format!("frame {frame}; expected a whole number from 0 to 9e15"))),
    }
}

/// Reads one pose: 6 numbers (translation, rotation vector), 7 (`tx ty tz qx qy qz qw`), 8 (frame before these), or
/// 12 or 16 (matrix by rows). Metres and radians.
///
/// # Errors
/// [`DeviceError`] that names the file.
pub fn read_pose(path: &Path) -> Result<SE3, DeviceError> {
    let v: Vec<f64> = rows(path)?.into_iter().flat_map(|(_, v)| v).collect();
    let pose = match v.len() {
        6 => Some(SE3 {
            rotation: UnitQuaternion::from_scaled_axis(Vector3::new(v[3], v[4], v[5])),
            translation: Vector3::new(v[0], v[1], v[2]),
        }),
        7 => from_quaternion(&v),
        8 => from_quaternion(&v[1..]),
        12 | 16 => from_matrix(&v),
        n => {
            let why = format!("{n} numbers; expected a pose of 6, 7, 8, 12 or 16 numbers");
            return Err(DeviceError::new(path.display(), why));
        }
    };
    pose.ok_or_else(|| {
        DeviceError::new(path.display(), "no rotation; expected a unit quaternion or a rotation matrix")
    })
}

fn from_quaternion(v: &[f64]) -> Option<SE3> {
    let q = Quaternion::new(v[6], v[3], v[4], v[5]);
    ((q.norm() - 1.0).abs() < 1e-3).then(|| SE3 {
        rotation: UnitQuaternion::from_quaternion(q),
        translation: Vector3::new(v[0], v[1], v[2]),
    })
}

/// Files keep few digits, so the rotation is the nearest one to the matrix.
fn from_matrix(v: &[f64]) -> Option<SE3> {
    let m = Matrix3::from_fn(|r, c| v[4 * r + c]);
    let defect = (m.transpose() * m - Matrix3::identity()).norm();
    if !(defect < 1e-3 && m.determinant() > 0.0) {
        return None;
    }
    let svd = m.svd(true, true);
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(svd.u? * svd.v_t?));
    Some(SE3 { rotation, translation: Vector3::new(v[3], v[7], v[11]) })
}

/// Lines of finite numbers with their line numbers, from 1.
fn rows(path: &Path) -> Result<Vec<(usize, Vec<f64>)>, DeviceError> {
    let all = numbers(path)?;
    for (line, row) in &all {
        if let Some(v) = row.iter().find(|v| !v.is_finite()) {
            let why = format!("line {line}: found {v}; expected a finite number");
            return Err(DeviceError::new(path.display(), why));
        }
    }
    Ok(all)
}

/// Lines of numbers, infinite ones and NaN too, with their line numbers from 1.
fn numbers(path: &Path) -> Result<Vec<(usize, Vec<f64>)>, DeviceError> {
    let text = vt_core::file::read_text(path, MOST).map_err(|e| DeviceError::new(path.display(), e))?;
    let mut out = vec![];
    for (k, line) in text.lines().enumerate() {
        let words = line.split('#').next().unwrap_or_default();
        let mut row = vec![];
        for word in words.split(|c: char| c.is_whitespace() || ",;".contains(c)).filter(|w| !w.is_empty()) {
            row.push(word.parse::<f64>().map_err(|_| {
                DeviceError::new(path.display(), format!("line {}: found `{word}`; expected a number", k + 1))
            })?);
        }
        if !row.is_empty() {
            out.push((k + 1, row));
        }
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_forms_of_one_pose_agree() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("pose.txt");
        // A quarter turn about z.
        let forms = [
            "1 2 3 0 0 1.5707963267948966",
            "1 2 3  0 0 0.7071067811865476 0.7071067811865476",
            "9, 1, 2, 3, 0, 0, 0.7071067811865476, 0.7071067811865476",
            "0 -1 0 1\n1 0 0 2\n0 0 1 3\n",
            "# c\n0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n",
        ];
        for text in forms {
            std::fs::write(&file, text).unwrap();
            let p = read_pose(&file).unwrap();
            let image = p.act(&nalgebra::Point3::new(1.0, 0.0, 0.0));
            assert!((image - nalgebra::Point3::new(1.0, 3.0, 3.0)).norm() < 1e-12, "{text}");
        }
        for (text, word) in [("1 2", "2 numbers"), ("1 2 x", "`x`"), ("1 2 3 1 1 1 1", "no rotation")] {
            std::fs::write(&file, text).unwrap();
            assert!(read_pose(&file).unwrap_err().to_string().contains(word));
        }
    }

    #[test]
    fn boxes_and_corners_are_read_by_line() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("truth.txt");
        std::fs::write(&file, "10,20,4,2\nnan,nan,nan,nan\n11\t20\t4\t2\n").unwrap();
        let truth = Truth::read_boxes(&file, 1).unwrap();
        assert_eq!(truth.corners.keys().collect::<Vec<_>>(), [&1, &3]);
        assert_eq!(
            truth.corners[&1],
            [(9.5, 19.5), (13.5, 19.5), (13.5, 21.5), (9.5, 21.5)].map(|(x, y)| Point2::new(x, y))
        );
        assert!(
            Truth::read_corners(&file, 1).unwrap_err().to_string().contains("line 1: 4 numbers; expected 8")
        );
        std::fs::write(&file, "1 2 3 4 5 6 7 8\n").unwrap();
        assert_eq!(Truth::read_corners(&file, 0).unwrap().corners[&0][3], Point2::new(7.0, 8.0));
        std::fs::write(&file, "nan nan nan nan\n").unwrap();
        assert!(Truth::read_boxes(&file, 0).unwrap_err().to_string().contains("no frames"));
    }

    #[test]
    fn truth_is_read_by_frame_number() {
        let dir = tempfile::tempdir().unwrap();
        let eye = "1 0 0 0.1\n0 1 0 0.2\n0 0 1 0.3\n0 0 0 1\n";
        std::fs::write(dir.path().join("Camera_007.txt"), eye).unwrap();
        std::fs::write(dir.path().join("notes.md"), "nothing").unwrap();
        let truth = Truth::read_matrices(dir.path()).unwrap();
        assert_eq!(truth.poses[&7].translation, Vector3::new(0.1, 0.2, 0.3));
        let tum = dir.path().join("t.tum");
        std::fs::write(&tum, "# x\n7 0.1 0.2 0.3 0 0 0 1\n8 0 0 0 0 0 0 1\n").unwrap();
        assert_eq!(Truth::read_tum(&tum).unwrap().poses.keys().collect::<Vec<_>>(), [&7, &8]);
        std::fs::write(&tum, "7 0.1 0.2\n").unwrap();
        assert!(Truth::read_tum(&tum).unwrap_err().to_string().contains("line 1: 3 numbers"));
        std::fs::write(&tum, "7 nan 0 0 0 0 0 1\n").unwrap();
        assert!(Truth::read_tum(&tum).unwrap_err().to_string().contains("line 1: found NaN"));
    }

    #[test]
    fn estimates_may_be_missing_and_covariances_may_not() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("e.tum");
        std::fs::write(&file, "0 0 0 1 0 0 0 2\n3 nan nan nan 0 0 0 1\n4 0 0 1 0 0 0 0\n").unwrap();
        let e = read_estimates(&file).unwrap();
        assert_eq!(e[&0].map(|p| p.translation.z), Some(1.0));
        assert_eq!((e[&3], e[&4], e.len()), (None, None, 3));
        let wrong =
            [("1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1", "second"), ("1.5 0 0 0 0 0 0 1", "whole"), ("1 2", "8")];
        for (text, word) in wrong {
            std::fs::write(&file, text).unwrap();
            assert!(read_estimates(&file).unwrap_err().to_string().contains(word));
        }
        let values = |n: usize| (1..=n).map(|k| format!(",{k}")).collect::<String>();
        std::fs::write(&file, format!("# c\n7{}\n", values(21))).unwrap();
        let c = read_covariances(&file).unwrap();
        assert_eq!((c[0].0, c[0].1, c[0].2[(0, 5)], c[0].2[(1, 0)], c[0].2[(5, 5)]), (2, 7, 6.0, 2.0, 21.0));
        for text in [format!("7{}", values(20)), format!("7{},nan", values(20))] {
            std::fs::write(&file, text).unwrap();
            assert!(read_covariances(&file).unwrap_err().to_string().contains("line 1"));
        }
    }
}
