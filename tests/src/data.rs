//! Real data, found through environment variables and never committed.

use std::path::PathBuf;

/// The folder that the environment variable `variable` names.
///
/// Without it the caller skips its check, with a printed reason; under `VT_REQUIRE_DATA=1` its absence is a failure.
///
/// # Panics
/// When the data are required and absent.
pub fn root(variable: &str) -> Option<PathBuf> {
    let path = std::env::var_os(variable).map(PathBuf::from).filter(|p| p.is_dir());
    if path.is_none() {
        let required = std::env::var_os("VT_REQUIRE_DATA").is_some_and(|v| v == "1");
        assert!(!required, "`{variable}` must name the folder of the data set");
        println!("skipped: `{variable}` does not name a folder");
    }
    path
}
