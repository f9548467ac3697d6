//! Damage anywhere in the text of a good task gives a task, or problems with a place.

use std::path::{Path, PathBuf};

use vt_core::laws::{damage, for_cases};
use vt_task::scenarios::LIBRARY;
use vt_task::{Document, Registry, TaskErrors, check, explain};

/// The tasks and scenarios that come with the program.
fn texts() -> Vec<(PathBuf, String)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tasks");
    let mut out = vec![];
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        out.push((path.clone(), std::fs::read_to_string(path).unwrap()));
    }
    out.sort();
    assert!(out.len() >= 5, "the tasks are found");
    out.extend(LIBRARY.iter().map(|(name, text)| (PathBuf::from(name), (*text).to_owned())));
    out
}

#[test]
fn damaged_tasks_are_tasks_or_problems() {
    let (registry, texts) = (Registry::standard(), texts());
    // Whether a file is there is no matter here.
    let environment = |_: &str| Some("nowhere".to_owned());
    let read = |path: &Path, text: &str| -> Result<(), TaskErrors> {
        let base = path.parent().unwrap_or(Path::new(""));
        let document = Document::parse("task.toml", text, base, &[], &environment)?;
        let task = check(&document, &registry)?;
        assert!(!explain::explain(&task, &registry).is_empty());
        Ok(())
    };
    let wrong = std::cell::Cell::new(0);
    for_cases(20_000, (0..texts.len(), damage()), |(k, damage)| {
        let (path, text) = &texts[k];
        // What is no text is found by the reader of files.
        let text = String::from_utf8_lossy(&damage.apply(text.as_bytes())).into_owned();
        if let Err(e) = read(path, &text) {
            wrong.set(wrong.get() + 1);
            assert!(!e.problems.is_empty());
            for problem in &e.problems {
                assert!(problem.problem.expected().is_some(), "{problem}");
                assert!(problem.line().is_some() && problem.column().is_some(), "no place: {problem}");
            }
        }
    });
    assert!(wrong.get() > 5000, "{wrong:?} problems");
}
