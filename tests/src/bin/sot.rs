//! The colour particle filter on sequences with true boxes: variants of its task, and which of them is chosen when the sequence in
//! question has no say.
//!
//! Every line of the file of variants is `name: SETTING; SETTING; …`, settings as in `--set`; lines with `#` are remarks. Each
//! variant starts at the first true box, is run with several seeds, and has the mean success area. *Leave one out*: for each
//! sequence the variant that is best in the mean of the others.
//!
//! usage: `sot [--variants FILE] [--python PYTHON] [--out DIR]`

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Parser;
use rayon::prelude::*;
use vt_core::report::Status;
use vt_fusion::loss::LossSigns;
use vt_tests::sot::{Run, Sequence};

/// Scores the colour particle filter on sequences with true boxes.
#[derive(Parser)]
struct Arguments {
    /// Folder with the data, of which `sot` holds the sequences.
    #[arg(long, env = "VT_DATA", default_value = "../shared/data")]
    data: PathBuf,
    /// Variants of the task; the task as it is when absent.
    #[arg(long)]
    variants: Option<PathBuf>,
    /// Runs of each, with seeds from 1.
    #[arg(long, default_value_t = 3)]
    seeds: u64,
    /// Settings for all variants.
    #[arg(long = "set")]
    set: Vec<String>,
    /// Only this sequence.
    #[arg(long)]
    only: Option<String>,
    /// An interpreter that has OpenCV, whose Canny is timed on the same pictures.
    #[arg(long)]
    python: Option<PathBuf>,
    /// Folder for boxes and for signs of loss with overlaps, `VARIANT-SEQUENCE-SEED.txt` and `.csv`.
    #[arg(long)]
    out: Option<PathBuf>,
}

/// A named list of settings.
struct Variant {
    name: String,
    set: Vec<String>,
}

fn variants(a: &Arguments) -> Result<Vec<Variant>> {
    let Some(file) = &a.variants else {
        return Ok(vec![Variant { name: "as it is".into(), set: a.set.clone() }]);
    };
    let text = fs::read_to_string(file).with_context(|| file.display().to_string())?;
    let lines = text.lines().map(str::trim).filter(|l| !l.is_empty() && !l.starts_with('#'));
    let variant = |line: &str| {
        let (name, rest) = line.split_once(':').with_context(|| format!("no name in: {line}"))?;
        let own = rest.split(';').map(str::trim).filter(|s| !s.is_empty()).map(String::from);
        Ok(Variant { name: name.trim().into(), set: a.set.iter().cloned().chain(own).collect() })
    };
    lines.map(variant).collect()
}

/// Median CPU milliseconds of OpenCV's Canny (50, 150; one thread) over all grey pictures of a folder.
const CANNY: &str = "
import sys, time, pathlib, cv2
cv2.setNumThreads(1)
files = sorted(p for p in pathlib.Path(sys.argv[1]).iterdir() if p.suffix.lower() in ('.jpg', '.png'))
pictures = [cv2.imread(str(p), cv2.IMREAD_GRAYSCALE) for p in files]
times = []
for _ in range(3):
    for picture in pictures:
        start = time.process_time()
        cv2.Canny(picture, 50, 150)
        times.append(1e3 * (time.process_time() - start))
print(sorted(times)[len(times) // 2])
";

fn canny(python: &PathBuf, sequence: &Sequence) -> Result<f64> {
    let output = Command::new(python).args(["-c", CANNY]).arg(&sequence.pictures).output();
    let output = output.with_context(|| python.display().to_string())?;
    ensure!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    Ok(String::from_utf8(output.stdout)?.trim().parse()?)
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count() as f64
}

fn row(name: &str, values: &[f64], rest: &str) {
    let cells: Vec<String> = values.iter().map(|v| format!("{v:.3}")).collect();
    println!("| {name} | {} | {:.3} | {rest} |", cells.join(" | "), mean(values.iter().copied()));
}

fn main() -> Result<()> {
    let a = Arguments::parse();
    let mut folders: Vec<PathBuf> =
        fs::read_dir(a.data.join("sot"))?.map(|e| Ok(e?.path())).collect::<Result<_>>()?;
    folders.sort();
    folders.retain(|f| f.is_dir() && a.only.as_ref().is_none_or(|o| f.ends_with(o)));
    let sequences: Vec<Sequence> = folders.iter().map(|f| Sequence::load(f)).collect::<Result<_>>()?;
    let names: Vec<&str> = sequences.iter().map(|s| s.name.as_str()).collect();
    println!("| success area | {} | mean | ms a frame, lost frames, placed again |", names.join(" | "));
    println!("|---|{}---|---|", "---|".repeat(names.len()));
    let mut scores: Vec<(String, Vec<f64>)> = vec![];
    let mut last = vec![];
    for variant in variants(&a)? {
        let jobs: Vec<(usize, u64)> =
            (0..sequences.len()).flat_map(|k| (1..=a.seeds).map(move |s| (k, s))).collect();
        let run = |&(k, seed): &(usize, u64)| sequences[k].track(&variant.set, seed);
        let runs: Vec<Run> = jobs.par_iter().map(run).collect::<Result<_>>()?;
        let of = |k: usize| jobs.iter().zip(&runs).filter(move |((j, _), _)| *j == k).map(|(_, r)| r);
        let auc: Vec<f64> = (0..sequences.len()).map(|k| mean(of(k).map(|r| r.auc))).collect();
        let ms = |k: usize| mean(of(k).map(|r| r.ms[1]));
        let lost = |r: &Run| r.statuses.iter().filter(|s| **s == Status::Lost).count();
        let (lost, again) = runs.iter().fold((0, 0), |(l, p), r| (l + lost(r), p + r.reinitialized));
        let all = mean((0..sequences.len()).map(ms));
        row(&variant.name, &auc, &format!("{all:.2}, {}, {again}", lost as u64 / a.seeds));
        if let Some(folder) = &a.out {
            fs::create_dir_all(folder)?;
            for ((k, seed), run) in jobs.iter().zip(&runs) {
                let line = |b: &vt_core::metrics::Rectangle| {
                    format!("{:.2},{:.2},{:.2},{:.2}\n", b.x, b.y, b.width, b.height)
                };
                let text: String = run.boxes.iter().map(line).collect();
                let stem = format!("{}-{}-{seed}", variant.name, names[*k]);
                fs::write(folder.join(format!("{stem}.txt")), text)?;
                let line = |(overlap, s): &(f64, LossSigns)| {
                    let numbers = [s.unsupported, s.log_ratio, s.misfit, s.surprise, s.spread];
                    let cells = numbers.map(|v| format!(",{v:.3}")).concat();
                    format!("{overlap:.3}{cells}\n")
                };
                let head = "overlap,unsupported,log_ratio,misfit,surprise,spread\n";
                let text: String = run.signs.iter().map(line).collect();
                fs::write(folder.join(format!("{stem}.csv")), head.to_owned() + &text)?;
            }
        }
        last = (0..sequences.len()).map(ms).collect();
        scores.push((variant.name, auc));
    }
    if scores.len() > 1 && sequences.len() > 1 {
        leave_one_out(&scores, &names);
    }
    if let Some(python) = &a.python {
        let theirs: Vec<f64> = sequences.iter().map(|s| canny(python, s)).collect::<Result<_>>()?;
        row("ms a frame of the last variant", &last, "");
        row("ms of OpenCV's Canny", &theirs, "");
        let ratios: Vec<f64> = last.iter().zip(&theirs).map(|(o, t)| o / t).collect();
        row("ratio", &ratios, "");
    }
    Ok(())
}

/// Prints for each sequence the score of the variant that is best on the others.
fn leave_one_out(scores: &[(String, Vec<f64>)], names: &[&str]) {
    let mut left = vec![];
    for k in 0..names.len() {
        let others = |auc: &[f64]| mean(auc.iter().enumerate().filter(|(j, _)| *j != k).map(|(_, v)| *v));
        let best = scores.iter().max_by(|a, b| others(&a.1).total_cmp(&others(&b.1)));
        if let Some((name, auc)) = best {
            println!("without {}: {name} ({:.3} on the others)", names[k], others(auc));
            left.push(auc[k]);
        }
    }
    row("leave one out", &left, "");
    if let Some((name, auc)) =
        scores.iter().max_by(|a, b| mean(a.1.iter().copied()).total_cmp(&mean(b.1.iter().copied())))
    {
        row(&format!("best: {name}"), auc, "");
    }
}
