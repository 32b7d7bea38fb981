//! The name that somebody who mistyped may have meant.
//!
//! Near is measured by the optimal string alignment distance: how many characters must be put in, left out, replaced, or swapped
//! with their neighbour. A third of the word may be wrong, so that short names do not attract everything.

/// The candidate nearest to `word`, if any is near enough to be worth proposing. Of several equally near ones the first.
///
/// Costs `word` × candidate characters for each candidate of about the same length, nothing for the others.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let word: Vec<char> = word.chars().collect();
    let mut best = None;
    let mut limit = (word.len() / 3).max(1);
    for candidate in candidates {
        let letters: Vec<char> = candidate.chars().collect();
        if letters == word {
            return Some(candidate);
        }
        if letters.len().abs_diff(word.len()) > limit {
            continue;
        }
        let distance = alignment_distance(&word, &letters);
        // A word all of whose letters are wrong is another word, however short.
        if distance <= limit && distance < word.len().max(letters.len()) {
            best = Some(candidate);
            limit = distance - 1;
        }
    }
    best
}

/// The optimal string alignment distance of two words.
fn alignment_distance(a: &[char], b: &[char]) -> usize {
    // Rows of the classical table: distances of the first i letters of `a` to all beginnings of `b`.
    let mut before_last = vec![0; b.len() + 1];
    let mut last: Vec<usize> = (0..=b.len()).collect();
    let mut row = vec![0; b.len() + 1];
    for (i, &from) in a.iter().enumerate() {
        row[0] = i + 1;
        for (j, &to) in b.iter().enumerate() {
            let replaced = last[j] + usize::from(from != to);
            row[j + 1] = replaced.min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && from == b[j - 1] && a[i - 1] == to {
                row[j + 1] = row[j + 1].min(before_last[j - 1] + 1);
            }
        }
        std::mem::swap(&mut before_last, &mut last);
        std::mem::swap(&mut last, &mut row);
    }
    last[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_of_known_words() {
        let cases = [
            ("", "", 0),
            ("", "abc", 3),
            ("abc", "abc", 0),
            ("kitten", "sitting", 3),
            ("Curise", "Cruise", 1),
            ("ca", "abc", 3),
            ("ä", "a", 1),
        ];
        for (a, b, distance) in cases {
            let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
            assert_eq!(alignment_distance(&a, &b), distance, "{a:?} {b:?}");
            assert_eq!(
                alignment_distance(&b, &a),
                distance,
                "the distance is symmetric"
            );
        }
    }

    #[test]
    fn only_near_names_are_proposed() {
        let names = ["Cruise", "Escape", "turn", "Back", "A"];
        let cases = [
            ("Back", Some("Back")),
            ("Curise", Some("Cruise")),
            ("cruise", Some("Cruise")),
            ("Escaep", Some("Escape")),
            ("trun", Some("turn")),
            ("Backk", Some("Back")),
            ("Follow", None),
            ("B", None),
            ("", None),
        ];
        for (word, expected) in cases {
            assert_eq!(nearest(word, names), expected, "{word:?}");
        }
    }

    #[test]
    fn the_nearest_wins_then_the_first() {
        assert_eq!(
            nearest("state1", ["state22", "state2", "state3"]),
            Some("state2")
        );
        assert_eq!(
            nearest("state1", ["state2", "state3", "state1"]),
            Some("state1")
        );
    }
}
