//! Damaged files of poses, covariances and times give values or errors that name the file.

use std::path::Path;

use vt_core::laws::{damage, for_cases};
use vt_io::timestamps;
use vt_io::truth::{Truth, read_covariances, read_estimates, read_pose};

const POSES: &str = "# frame tx ty tz qx qy qz qw\n0 0.1 0.2 1.5 0 0 0 1\n1 0.1,0.2,1.5,0.5,0.5,0.5,0.5\n\
                     7 1e-3 -2 3 0 0 0.6 0.8\n";
const TIMES: &str = "# frame seconds\n0 0.000000000\n1 0.040000000\n2 0.080000000\n";

/// What is read, or why not.
type Read = fn(&Path) -> Result<usize, vt_core::error::DeviceError>;

#[test]
fn damaged_numbers_are_values_or_errors() {
    let dir = tempfile::tempdir().unwrap();
    let values = (1..=21).map(|k| format!(",{k}e-6")).collect::<String>();
    let covariances = format!("0{values}\n5{values}\n");
    let readers: [(&str, &str, Read); 6] = [
        ("truth.tum", POSES, |p| Truth::read_tum(p).map(|t| t.poses.len())),
        ("estimates.tum", POSES, |p| read_estimates(p).map(|t| t.len())),
        ("covariances.csv", &covariances, |p| read_covariances(p).map(|c| c.len())),
        ("times.txt", TIMES, |p| timestamps::read(p).map(|t| t.len())),
        ("pose.txt", "0 -1 0 1\n1 0 0 2\n0 0 1 3\n0 0 0 1\n", |p| read_pose(p).map(|_| 1)),
        ("matrices/pose_3.txt", "1 0 0 1\n0 1 0 2\n0 0 1 3\n", |p| {
            Truth::read_matrices(p.parent().unwrap()).map(|t| t.poses.len())
        }),
    ];
    std::fs::create_dir(dir.path().join("matrices")).unwrap();
    for (name, text, read) in readers {
        std::fs::write(dir.path().join(name), text).unwrap();
        assert!(read(&dir.path().join(name)).unwrap() > 0, "{name} without damage");
    }
    for_cases(3000, (0..readers.len(), damage()), |(kind, damage)| {
        let (name, text, read) = readers[kind];
        let path = dir.path().join(name);
        std::fs::write(&path, damage.apply(text.as_bytes())).unwrap();
        if let Err(e) = read(&path) {
            let e = e.to_string();
            assert!(e.contains(name) && e.contains("expected"), "{e}");
        }
    });
}
