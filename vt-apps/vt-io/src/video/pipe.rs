//! A child process that is read from and never outlives its reader.

use std::ffi::OsString;
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;
use std::process::{Child, ChildStderr, ChildStdout, Command, Stdio};
use std::thread::JoinHandle;

use vt_core::error::DeviceError;

/// Bytes of complaints that are kept.
const COMPLAINTS: usize = 4096;

/// A running program with its output.
pub(super) struct Pipe {
    child: Child,
    output: Option<ChildStdout>,
    complaints: Option<JoinHandle<String>>,
}

impl Pipe {
    /// Starts `program before file:PATH after`, without input.
    ///
    /// # Errors
    /// [`DeviceError`] that names the program.
    pub fn start(
        program: &Path,
        path: &Path,
        before: &[&str],
        after: &[&str],
    ) -> std::result::Result<Self, DeviceError> {
        // As a file, whatever its name looks like.
        let mut file = OsString::from("file:");
        file.push(path);
        let mut command = Command::new(program);
        command.args(before).arg(file).args(after);
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let mut child = command.spawn().map_err(|e| match e.kind() {
            ErrorKind::NotFound => {
                let why =
                    "not found; videos need it: install the package `ffmpeg` (./setup.sh does on Debian)";
                DeviceError::new(program.display(), why)
            }
            _ => DeviceError::new(program.display(), e),
        })?;
        let output = child.stdout.take();
        // Read beside the output: a full pipe would stop the program.
        let complaints = child.stderr.take().map(|from| std::thread::spawn(move || heard(from)));
        Ok(Self { child, output, complaints })
    }

    /// Fills `buffer` and returns how much of it was filled before the output ended.
    pub fn fill(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let Some(output) = &mut self.output else { return Ok(0) };
        let mut got = 0;
        while got < buffer.len() {
            match output.read(&mut buffer[got..]) {
                Ok(0) => break,
                Ok(n) => got += n,
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(e),
            }
        }
        Ok(got)
    }

    /// All of the output, if that is not more than `most` bytes.
    pub fn rest(&mut self, most: u64) -> Result<Vec<u8>> {
        let mut out = vec![];
        if let Some(output) = &mut self.output {
            output.take(most + 1).read_to_end(&mut out)?;
        }
        match out.len() as u64 > most {
            true => {
                Err(Error::new(ErrorKind::InvalidData, format!("more than {most} bytes about its frames")))
            }
            false => Ok(out),
        }
    }

    /// Waits for the end of a program whose output has ended: whether all went well, and its last complaint.
    pub fn finish(&mut self) -> (bool, String) {
        self.output = None;
        let good = self.child.wait().is_ok_and(|status| status.success());
        let said = self.complaints.take().and_then(|thread| thread.join().ok()).unwrap_or_default();
        (good, said)
    }

    /// Ends the program where it is.
    pub fn stop(&mut self) {
        self.output = None;
        // It may have ended already.
        let _ = self.child.kill();
        self.finish();
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        self.stop();
    }
}

/// The last line that is not empty, of the first bytes; the others are read too.
fn heard(mut from: ChildStderr) -> String {
    let (mut kept, mut buffer) = (vec![], [0; 1024]);
    while let Ok(n @ 1..) = from.read(&mut buffer) {
        kept.extend_from_slice(&buffer[..n.min(COMPLAINTS - kept.len())]);
    }
    let text = String::from_utf8_lossy(&kept).into_owned();
    text.lines().map(str::trim).rfind(|line| !line.is_empty()).unwrap_or_default().to_owned()
}
