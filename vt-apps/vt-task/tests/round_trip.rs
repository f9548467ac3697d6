//! Printing and re-reading a task is the identity.

use std::path::Path;

use proptest::prelude::*;
use vt_task::language::{
    Choice, Level, ModalitySection, ModelSection, Picture, SensorSection, TargetSection,
};
use vt_task::{Document, Registry, Task, check, scenarios};

fn text() -> impl Strategy<Value = String> {
    // Quotes, braces, dollars, controls and letters of other scripts.
    proptest::collection::vec(
        prop_oneof![any::<char>(), Just('$'), Just('{'), Just('}'), Just('"'), Just('\\'), Just('\n')],
        0..12,
    )
    .prop_map(|c| c.into_iter().collect())
}

fn value() -> impl Strategy<Value = toml::Value> {
    let leaf = prop_oneof![
        text().prop_map(toml::Value::String),
        any::<i64>().prop_map(toml::Value::Integer),
        any::<bool>().prop_map(toml::Value::Boolean),
        proptest::num::f64::NORMAL.prop_map(toml::Value::Float),
    ];
    leaf.prop_recursive(3, 12, 4, |inner| {
        prop_oneof![
            proptest::collection::vec(inner.clone(), 0..4).prop_map(toml::Value::Array),
            proptest::collection::vec((text(), inner), 0..4)
                .prop_map(|entries| toml::Value::Table(entries.into_iter().collect())),
        ]
    })
}

fn params() -> impl Strategy<Value = toml::Table> {
    proptest::collection::vec((text(), value()), 0..4).prop_map(|entries| entries.into_iter().collect())
}

prop_compose! {
    fn choice()(kind in text(), params in params()) -> Choice {
        Choice { kind, params }
    }
}

prop_compose! {
    fn sensor()(name in text(), kind in text(), colour in any::<bool>(), params in params()) -> SensorSection {
        let picture = if colour { Picture::Colour } else { Picture::Grey };
        SensorSection { name, kind, picture, params, camera: None }
    }
}

prop_compose! {
    fn model()(name in text(), shape in choice(), appearance in proptest::option::of(choice()), warp in choice(),
               dynamics in choice()) -> ModelSection {
        ModelSection { name, shape, appearance, warp, dynamics }
    }
}

prop_compose! {
    fn modality()(kind in text(), level in 0..3_usize, sensor in text(), params in params()) -> ModalitySection {
        ModalitySection { kind, level: [Level::Pixel, Level::Feature, Level::Object][level], sensor, params }
    }
}

prop_compose! {
    fn target()(name in text(), model in text(), init in choice(), truth in proptest::option::of(choice()),
                modalities in proptest::collection::vec(modality(), 0..3), fusion in proptest::option::of(choice()),
                estimator in choice(), loss in proptest::option::of(choice()),
                reinit in proptest::option::of(choice())) -> TargetSection {
        TargetSection { name, model, init, truth, modalities, fusion, estimator, loss, reinit }
    }
}

prop_compose! {
    fn task()(title in proptest::option::of(text()), seed in any::<u32>(),
              variables in proptest::collection::btree_map("[A-Z]{1,8}", text(), 0..3),
              sensors in proptest::collection::vec(sensor(), 0..3), models in proptest::collection::vec(model(), 0..3),
              targets in proptest::collection::vec(target(), 0..3), association in proptest::option::of(choice()),
              outputs in proptest::collection::vec(choice(), 0..3)) -> Task {
        Task { version: 1, title, seed, variables, sensors, models, targets, association, outputs }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 200, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn any_task_comes_back_as_it_was(task in task()) {
        let printed = task.print();
        let document = Document::parse("printed", &printed, Path::new(""), &[], &|_| None).expect("printed text parses");
        let again = document.task().expect("printed text is a task");
        prop_assert_eq!(&again, &task);
        prop_assert_eq!(again.print(), printed);
    }
}

#[test]
fn our_own_tasks_come_back_and_fit_the_schema_by_name() {
    let folders = ["../tasks", "../scenarios"].map(|f| Path::new(env!("CARGO_MANIFEST_DIR")).join(f));
    let mut count = 0;
    for entry in folders.iter().flat_map(|f| std::fs::read_dir(f).unwrap()) {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.lines().count() <= 75, "{}: a task is one page", path.display());
        let document =
            Document::parse("t", &text, path.parent().unwrap(), &[], &|_| Some("/data".into())).unwrap();
        let task = document.task().unwrap();
        let again = Document::of(&task, Path::new("")).unwrap().task().unwrap();
        assert_eq!(again, task);
        let kinds: Vec<String> = Registry::standard().listings().into_iter().map(|l| l.kind).collect();
        assert!(task.targets.iter().all(|t| kinds.contains(&t.estimator.kind)));
        count += 1;
    }
    assert!(count >= 3 + scenarios::LIBRARY.len());
}

#[test]
fn a_task_made_in_code_is_checked_like_a_file() {
    let task = Task { version: 1, outputs: vec![Choice::of("posse")], ..Task::default() };
    let document = Document::of(&task, Path::new("")).unwrap();
    let errors = check(&document, &Registry::standard()).unwrap_err();
    let nearest: Vec<_> = errors.problems.iter().filter_map(|p| p.problem.nearest()).collect();
    assert_eq!(nearest, ["poses"]);
}

#[test]
fn scenarios_are_short_checked_tasks_and_know_the_truth_of_every_target() {
    let registry = Registry::standard();
    for (name, text) in scenarios::LIBRARY {
        assert!(text.lines().count() <= 60 && text.starts_with("# "), "{name}: one page with a heading");
        let document = scenarios::find(name, &[]).unwrap().unwrap();
        let task = check(&document, &registry).unwrap();
        assert!(task.targets.iter().all(|t| t.truth.is_some()), "{name}");
        let cameras = scenarios::cameras(&document, &task, &registry).unwrap();
        assert!(cameras.iter().all(|c| c.objects.len() == c.camera.world().objects.len()));
        let recorded = scenarios::recorded(&document, &task, &cameras);
        assert!(recorded.sensors.iter().all(|s| s.kind == "images"), "{name}");
        let text = recorded.print();
        let again =
            Document::parse("recorded", &text, Path::new(""), &[], &|_| None).unwrap().task().unwrap();
        assert_eq!(again, recorded, "{name}");
    }
    assert!(scenarios::find("no-such-thing", &[]).is_none());
    assert!(scenarios::find("still", &["seed=x=".to_owned()]).unwrap().unwrap().task().is_err());
}
