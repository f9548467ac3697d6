use std::fmt;
use std::str::FromStr;

/// Colours by name, sRGB.
const NAMES: [(&str, [u8; 3]); 16] = [
    ("black", [0, 0, 0]),
    ("white", [255, 255, 255]),
    ("grey", [128, 128, 128]),
    ("red", [255, 0, 0]),
    ("green", [0, 160, 0]),
    ("blue", [0, 0, 255]),
    ("yellow", [255, 255, 0]),
    ("orange", [255, 140, 0]),
    ("brown", [140, 80, 30]),
    ("pink", [255, 170, 190]),
    ("purple", [128, 0, 128]),
    ("magenta", [255, 0, 255]),
    ("cyan", [0, 255, 255]),
    ("turquoise", [64, 200, 190]),
    ("beige", [235, 220, 180]),
    ("skin", [224, 172, 140]),
];

/// A colour and the part of the object's visible surface that has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColourShare {
    /// sRGB.
    pub rgb: [u8; 3],
    /// Part in 0..=1.
    pub share: f64,
}

/// Colours of an object, whose shares add up to 1.
///
/// Reads text such as `70 % green, 30 % yellow`; a colour is a name or `#rrggbb`.
#[derive(Clone, Debug, PartialEq)]
pub struct ColourStatistics {
    shares: Vec<ColourShare>,
}

/// Why text is no colour statistics.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ColourError {
    /// A part does not read `NUMBER % COLOUR`.
    #[error("colours: found `{found}`, expected a percentage and a colour such as `70 % green`")]
    Part {
        /// The part.
        found: String,
    },
    /// A colour has no known name.
    #[error("colours: found the colour `{found}`, expected #rrggbb or a name; nearest is `{nearest}`")]
    Name {
        /// The name.
        found: String,
        /// The known name most like it.
        nearest: &'static str,
    },
    /// The shares do not make a whole.
    #[error("colours: found shares that add up to {found:.1} %, expected 100 %")]
    Sum {
        /// Their sum.
        found: f64,
    },
}

impl ColourStatistics {
    /// Colours and shares; the sum may deviate from 1 by 1 %.
    ///
    /// # Errors
    /// [`ColourError::Sum`] for shares that are negative, not finite, or do not add up.
    pub fn new(mut shares: Vec<ColourShare>) -> Result<Self, ColourError> {
        let sum: f64 = shares.iter().map(|s| s.share).sum();
        let good = shares.iter().all(|s| s.share >= 0.0) && (sum - 1.0).abs() <= 0.01;
        if !good {
            return Err(ColourError::Sum { found: 100.0 * sum });
        }
        shares.iter_mut().for_each(|s| s.share /= sum);
        Ok(Self { shares })
    }

    /// Colours in the order given.
    #[must_use]
    pub fn shares(&self) -> &[ColourShare] {
        &self.shares
    }
}

impl FromStr for ColourStatistics {
    type Err = ColourError;

    fn from_str(text: &str) -> Result<Self, ColourError> {
        let part = |text: &str| {
            let wrong = || ColourError::Part { found: text.trim().to_owned() };
            let (number, colour) = text.split_once('%').ok_or_else(wrong)?;
            let percent: f64 = number.trim().parse().map_err(|_| wrong())?;
            Ok(ColourShare { rgb: parse_colour(colour.trim())?, share: percent / 100.0 })
        };
        Self::new(text.split(',').map(part).collect::<Result<_, ColourError>>()?)
    }
}

impl fmt::Display for ColourStatistics {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, ColourShare { rgb, share }) in self.shares.iter().enumerate() {
            let separator = if i > 0 { ", " } else { "" };
            // Two decimals of a percentage are what a person writes.
            let percent = (share * 1e4).round() / 1e2;
            match NAMES.iter().find(|n| n.1 == *rgb) {
                Some((name, _)) => write!(f, "{separator}{percent} % {name}")?,
                None => write!(f, "{separator}{percent} % #{:02x}{:02x}{:02x}", rgb[0], rgb[1], rgb[2])?,
            }
        }
        Ok(())
    }
}

fn parse_colour(text: &str) -> Result<[u8; 3], ColourError> {
    let lower = text.to_lowercase();
    let hex = lower.strip_prefix('#').filter(|h| h.len() == 6 && h.bytes().all(|b| b.is_ascii_hexdigit()));
    if let Some(value) = hex.and_then(|h| u32::from_str_radix(h, 16).ok()) {
        let [_, r, g, b] = value.to_be_bytes();
        return Ok([r, g, b]);
    }
    let spelled = if lower == "gray" { "grey" } else { &lower };
    let known = NAMES.iter().find(|n| n.0 == spelled).map(|n| n.1);
    known.ok_or_else(|| {
        let nearest = NAMES.iter().min_by_key(|n| edit_distance(n.0, spelled)).map_or("white", |n| n.0);
        ColourError::Name { found: text.to_owned(), nearest }
    })
}

/// Levenshtein distance.
fn edit_distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let above = row[j + 1];
            row[j + 1] = (diagonal + usize::from(x != *y)).min(above + 1).min(row[j] + 1);
            diagonal = above;
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_of_the_paper_is_read_and_printed_back() {
        let c: ColourStatistics = "70% green, 30 % Yellow".parse().unwrap();
        assert_eq!(c.shares()[0], ColourShare { rgb: [0, 160, 0], share: 0.7 });
        assert_eq!(c.to_string(), "70 % green, 30 % yellow");
        let c: ColourStatistics = "12.5 % #0a0B0c, 87.5 % gray".parse().unwrap();
        assert_eq!(c.to_string(), "12.5 % #0a0b0c, 87.5 % grey");
        assert_eq!(c.to_string().parse::<ColourStatistics>().unwrap(), c);
    }

    #[test]
    fn errors_say_what_is_expected() {
        let error = |text: &str| text.parse::<ColourStatistics>().unwrap_err();
        let name = error("70 % green, 30 % yelow");
        assert_eq!(name, ColourError::Name { found: "yelow".into(), nearest: "yellow" });
        assert!(matches!(error("green"), ColourError::Part { .. }));
        assert!(matches!(error("x % green"), ColourError::Part { .. }));
        assert!(matches!(error(""), ColourError::Part { .. }));
        assert!(matches!(error("100 % #12345ä"), ColourError::Name { .. }));
        assert_eq!(
            error("70 % green, 20 % yellow").to_string(),
            "colours: found shares that add up to 90.0 %, expected 100 %"
        );
        assert!(matches!(error("-50 % green, 150 % red"), ColourError::Sum { .. }));
        assert!(matches!(error("NaN % green"), ColourError::Sum { .. }));
    }
}
