//! The command line of the programs that follow flat models in uncalibrated pictures.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Parser;

use crate::{document, pictures, quoted, start};

/// Options of these programs.
#[derive(Parser)]
#[command(version)]
pub struct Cli {
    /// A task file instead of the built-in scene.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["images", "init", "reference"])]
    task: Option<PathBuf>,
    /// Pictures: a folder, or a pattern such as Image_%04d.png.
    #[arg(long, value_name = "FOLDER|PATTERN", requires = "init")]
    images: Option<String>,
    /// Box around the object in the first picture, pixels: left, upper, width, height.
    #[arg(long, value_name = "X,Y,W,H", requires = "images")]
    init: Option<String>,
    /// Picture that shows the object and nothing else; without it the object is learnt from the first picture.
    #[arg(long, value_name = "PICTURE", requires = "images")]
    reference: Option<String>,
    /// Folder for results; out/NAME when absent.
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Ends after so many frames.
    #[arg(long, value_name = "N")]
    max_frames: Option<usize>,
    /// Sets a value of the task, as in `vt run`.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// A program of this kind.
pub struct Program {
    /// Its name.
    pub name: &'static str,
    /// Its built-in scene, a task.
    pub simulated: &'static str,
    /// The task for own pictures, with a sensor `camera`, a model `object` and a target `object` whose init is a box.
    pub own: &'static str,
    /// Settings for the file of a reference picture; none where the program has no use for one.
    pub references: &'static [&'static str],
}

impl Program {
    /// Reads the command line and runs.
    pub fn main(&self) -> ExitCode {
        let cli = Cli::parse();
        let set = match self.settings(&cli) {
            Ok(own) => own.into_iter().chain(cli.set.iter().cloned()).collect::<Vec<_>>(),
            Err(message) => {
                eprintln!("error: {message}");
                return ExitCode::from(2);
            }
        };
        let (kind, text) = match cli.images {
            Some(_) => ("own pictures", self.own),
            None => ("built in", self.simulated),
        };
        let document = document(cli.task.as_deref(), &format!("{}.toml ({kind})", self.name), text, &set);
        let out = cli.out.unwrap_or_else(|| PathBuf::from("out").join(self.name));
        let results =
            [("boxes", "boxes.txt"), ("overlays", "overlays"), ("contact sheet", "contact_sheet.png")];
        start(document, &out, cli.max_frames, &results)
    }

    /// The options for own pictures as settings of the task.
    fn settings(&self, cli: &Cli) -> Result<Vec<String>, String> {
        let (Some(images), Some(init)) = (&cli.images, &cli.init) else { return Ok(vec![]) };
        let [x, y, w, h] = numbers(init)?;
        let mut set = vec![
            pictures(images),
            format!("models.object.shape.params.size=['{w} px', '{h} px']"),
            format!("targets.object.init.params.box=['{x} px', '{y} px', '{w} px', '{h} px']"),
        ];
        if let Some(reference) = &cli.reference {
            if self.references.is_empty() {
                return Err(format!("--reference {reference}: {} learns nothing from pictures", self.name));
            }
            set.extend(self.references.iter().map(|key| format!("{key}={}", quoted(reference))));
        }
        Ok(set)
    }
}

/// The four numbers of a box.
fn numbers(text: &str) -> Result<[f64; 4], String> {
    let bad =
        || format!("--init {text}: expected four numbers X,Y,W,H with a positive size, as in 120,80,60,90");
    let numbers: Vec<f64> = text.split(',').map_while(|n| n.trim().parse().ok()).collect();
    match numbers[..] {
        [x, y, w, h]
            if numbers.iter().all(|n| n.is_finite())
                && w > 0.0
                && h > 0.0
                && text.split(',').count() == 4 =>
        {
            Ok([x, y, w, h])
        }
        _ => Err(bad()),
    }
}

#[cfg(test)]
mod tests {
    use super::numbers;

    #[test]
    fn a_box_is_four_numbers() {
        assert_eq!(numbers("1, 2.5,30,40").unwrap(), [1.0, 2.5, 30.0, 40.0]);
        for bad in ["", "1,2,3", "1,2,3,4,5", "1,2,x,4", "1,2,0,4", "1,2,3,-4", "nan,2,3,4", "1,2,3,4,"] {
            let message = numbers(bad).unwrap_err();
            assert!(message.contains("X,Y,W,H"), "{bad}: {message}");
        }
    }
}
