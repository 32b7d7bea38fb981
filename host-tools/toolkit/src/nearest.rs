//! The name that somebody who mistyped may have meant.
//!
//! Near is measured by the optimal string alignment distance: how many characters must be put in,
//! left out, replaced, or swapped with their neighbour. A third of the word may be wrong, so that
//! short names do not attract everything, and no more than a few letters of a long one.

/// More wrong letters than this are no slip of the fingers, however long the word is.
const MAX_DISTANCE: usize = 8;

/// The candidate nearest to `word`, if any is near enough to be worth proposing. Of several equally
/// near ones the first.
///
/// Costs at most the characters of `word` times `MAX_DISTANCE` for each candidate of about the same
/// length, and far less where they differ from the beginning on; next to nothing for the others.
pub fn nearest<'a>(word: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let text = word;
    let word: Vec<char> = word.chars().collect();
    let mut best = None;
    let mut limit = (word.len() / 3).clamp(1, MAX_DISTANCE);
    for candidate in candidates {
        if candidate == text {
            return Some(candidate);
        }
        // No character has more than four bytes.
        if candidate.len() + limit < word.len() || candidate.len() / 4 > word.len() + limit {
            continue;
        }
        let letters: Vec<char> = candidate.chars().collect();
        if letters.len().abs_diff(word.len()) > limit {
            continue;
        }
        let Some(distance) = distance_within(&word, &letters, limit) else {
            continue;
        };
        // A word all of whose letters are wrong is another word, however short.
        if distance < word.len().max(letters.len()) {
            best = Some(candidate);
            limit = distance - 1;
        }
    }
    best
}

/// The optimal string alignment distance of two words, if it is at most `limit`, which is at least
/// the difference of their lengths.
fn distance_within(a: &[char], b: &[char], limit: usize) -> Option<usize> {
    // Rows of the classical table: distances of the first i letters of `a` to all beginnings of
    // `b`. What lies farther than `limit` from the diagonal is above the limit, and so is not
    // worked out.
    let beyond = limit + 1;
    let mut before_last = vec![beyond; b.len() + 1];
    let mut last: Vec<usize> = (0..=b.len()).map(|length| length.min(beyond)).collect();
    let mut row = vec![beyond; b.len() + 1];
    for (i, &from) in a.iter().enumerate() {
        let first = i.saturating_sub(limit);
        let end = b.len().min(i + limit + 1);
        row[first] = if first == 0 { i + 1 } else { beyond };
        let mut least = row[first];
        for (j, &to) in b.iter().enumerate().take(end).skip(first) {
            let replaced = last[j] + usize::from(from != to);
            let mut distance = replaced.min(last[j + 1] + 1).min(row[j] + 1);
            if i > 0 && j > 0 && from == b[j - 1] && a[i - 1] == to {
                distance = distance.min(before_last[j - 1] + 1);
            }
            row[j + 1] = distance;
            least = least.min(distance);
        }
        // The next row reads one place farther.
        if let Some(behind) = row.get_mut(end + 1) {
            *behind = beyond;
        }
        if least > limit {
            return None;
        }
        std::mem::swap(&mut before_last, &mut last);
        std::mem::swap(&mut last, &mut row);
    }
    last.last().copied().filter(|&distance| distance <= limit)
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
            for limit in a.len().abs_diff(b.len())..6 {
                let expected = (distance <= limit).then_some(distance);
                assert_eq!(distance_within(&a, &b, limit), expected, "{a:?} {b:?}");
                assert_eq!(distance_within(&b, &a, limit), expected, "it is symmetric");
            }
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
