//! The nearest valid name of a misspelt one.

/// The candidate with the smallest edit distance to `found`, when it is near enough to be what was meant.
pub fn nearest<'a>(found: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    let lower = found.to_lowercase();
    candidates
        .into_iter()
        .map(|c| (distance(&lower, &c.to_lowercase()), c))
        .filter(|(d, c)| *d <= 1 + c.chars().count().max(found.chars().count()) / 3)
        .min_by_key(|(d, _)| *d)
        .map(|(_, c)| c.to_owned())
}

/// Edit distance with insertion, deletion, substitution and exchange of neighbours (optimal string alignment).
pub fn distance(a: &str, b: &str) -> usize {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    let mut before: Vec<usize> = vec![0; b.len() + 1];
    let mut above: Vec<usize> = (0..=b.len()).collect();
    for i in 1..=a.len() {
        let mut row = vec![i; b.len() + 1];
        for j in 1..=b.len() {
            let change = above[j - 1] + usize::from(a[i - 1] != b[j - 1]);
            row[j] = change.min(above[j] + 1).min(row[j - 1] + 1);
            if i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] {
                row[j] = row[j].min(before[j - 2] + 1);
            }
        }
        before = std::mem::replace(&mut above, row);
    }
    above[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_count_edits() {
        assert_eq!(distance("kalman", "kalman"), 0);
        assert_eq!(distance("kalmna", "kalman"), 1);
        assert_eq!(distance("", "abc"), 3);
        assert_eq!(distance("sitting", "kitten"), 3);
    }

    #[test]
    fn only_near_names_are_suggested() {
        let names = ["particle", "kalman", "unscented"];
        assert_eq!(nearest("partcle", names).as_deref(), Some("particle"));
        assert_eq!(nearest("KALMAN", names).as_deref(), Some("kalman"));
        assert_eq!(nearest("zebra-crossing", names), None);
    }
}
