//! Times of the frames of a recorded sequence.

use std::collections::BTreeSet;
use std::path::Path;

use vt_core::error::DeviceError;
use vt_core::file::MOST;
use vt_core::time::Timestamp;

/// Times are whole nanoseconds of 64 bits.
const MOST_SECONDS: f64 = 4e9;

/// Reads a file of times: one number of seconds a line, or `frame seconds`; `#` starts a comment.
///
/// # Errors
/// [`DeviceError`] that names the file and the line.
pub fn read(path: &Path) -> Result<Vec<(Option<u64>, Timestamp)>, DeviceError> {
    let text = vt_core::file::read_text(path, MOST).map_err(|e| DeviceError::new(path.display(), e))?;
    let mut out = vec![];
    let mut numbers = BTreeSet::new();
    for (k, line) in text.lines().enumerate() {
        let words: Vec<&str> = line.split('#').next().unwrap_or_default().split_whitespace().collect();
        let fail = |found: &str| {
            let why =
                format!("line {}: found `{found}`; expected `seconds` or `frame seconds`, below 4e9", k + 1);
            DeviceError::new(path.display(), why)
        };
        let seconds = |word: &str| {
            word.parse::<f64>().ok().filter(|s| s.abs() < MOST_SECONDS).ok_or_else(|| fail(word))
        };
        match words[..] {
            [] => {}
            [s] => out.push((None, Timestamp::from_seconds(seconds(s)?))),
            [n, s] => {
                let number = n.parse().map_err(|_| fail(n))?;
                if !numbers.insert(number) {
                    let why = format!("line {}: second time of frame {number}; expected one", k + 1);
                    return Err(DeviceError::new(path.display(), why));
                }
                out.push((Some(number), Timestamp::from_seconds(seconds(s)?)));
            }
            _ => return Err(fail(line)),
        }
    }
    Ok(out)
}
