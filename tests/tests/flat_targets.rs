//! Flat targets by task files: any measurement under any estimator by one line, the same bytes at any number of threads.

use vt_core::report::BeliefRecord;
use vt_tests::flat::{self, CENTRES, ESTIMATORS, MODALITIES, SEED};

fn task(modalities: &str, estimator: &str) -> String {
    flat::task(SEED, modalities, estimator)
}

fn track(text: &str) -> Vec<BeliefRecord> {
    flat::track(text).expect("a run")
}

fn error(modalities: &str, estimates: &[BeliefRecord]) -> f64 {
    flat::error(estimates, &flat::truth(SEED, modalities).expect("a scene"))
}

/// Root mean square error that every pair of them keeps, pixels: the deviation of a coordinate's step from frame to frame.
const BOUND: f64 = 1.5;

/// Mass centres are those of a window of pixels that move or have a colour.
const CENTRE_BOUND: f64 = 3.0;

#[test]
fn any_measurement_runs_under_any_estimator() {
    let mut wrong = vec![];
    let bounds = MODALITIES.iter().map(|m| (m, BOUND)).chain(CENTRES.iter().map(|m| (m, CENTRE_BOUND)));
    for (modality, bound) in bounds {
        for estimator in ESTIMATORS {
            let error = error(modality, &track(&task(modality, estimator)));
            println!("{error:6.2} px  {modality} {estimator}");
            if error.is_nan() || error >= bound {
                wrong.push(format!("{error:.2} px of {bound}: {modality} under {estimator}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Static and dynamic fusion of mass centres, at one thread and at two.
#[test]
fn mass_centres_follow_the_object_however_they_are_fused() {
    let both = CENTRES.join(", ");
    let run = |fusion: &str, threads| {
        let text = task(&both, r#"{ kind = "kalman" }"#)
            .replace("[targets.init]", &format!("fusion = {fusion}\n[targets.init]"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
        pool.install(|| track(&text))
    };
    for fusion in
        [r#"{ kind = "stacked" }"#, r#"{ kind = "equivalent-measurements" }"#, r#"{ kind = "intersection" }"#]
    {
        let one = run(fusion, 1);
        let error = error(&both, &one);
        println!("{error:6.2} px  {fusion}");
        assert!(error < CENTRE_BOUND, "{error} px with {fusion}");
        assert_eq!(one, run(fusion, 2), "{fusion}");
    }
    // For linear measurements, places of a model that is only moved, it does not matter how static ones are fused.
    let moved = |fusion: &str| {
        let text = task(&both, r#"{ kind = "kalman" }"#)
            .replace("sim2", "translation")
            .replace(r#", rotation = "4 deg/s^0.5", scale = "3 %/s^0.5""#, "")
            .replace(r#", rotation = "2 deg", scale = "1 %""#, "")
            .replace("[targets.init]", &format!("fusion = {{ kind = \"{fusion}\" }}\n[targets.init]"));
        track(&text).into_iter().flat_map(|belief| belief.coordinates)
    };
    let apart = moved("stacked").zip(moved("sequential")).map(|(a, b)| (a - b).abs());
    assert!(apart.fold(0.0, f64::max) < 1e-6);
}

/// Every modality alone, and all of them in each kind of static fusion.
#[test]
fn the_same_bytes_at_one_and_two_threads() {
    let all = MODALITIES.join(", ");
    let particles = ESTIMATORS[0];
    let mut tasks: Vec<String> = MODALITIES.iter().map(|modality| task(modality, particles)).collect();
    tasks.push(task(&all, particles));
    for fusion in ["stacked", "sequential", "information-sum"] {
        let fused = format!("{}\nfusion = {{ kind = \"{fusion}\" }}", ESTIMATORS[1]);
        tasks.push(task(&all, &fused));
    }
    for task in tasks {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| track(&task))
        };
        assert_eq!(run(1), run(2), "{task}");
    }
}
