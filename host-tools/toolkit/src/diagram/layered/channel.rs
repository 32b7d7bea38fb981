//! The space between two layers: lines that end in other columns than they begin get a row each for
//! the way across.
//!
//! Channel routing in the manner of Hashimoto and Stevens (1971), with detours where lines would
//! change places (Deutsch 1976).

/// A line through the channel: its column at the top, and that at the bottom. Both are even;
/// columns at the top differ, and so do those at the bottom.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Line {
    /// Column at the top, in cells.
    pub top: i32,
    /// Column at the bottom, in cells.
    pub bottom: i32,
}

/// A piece of a line's way: at which track it goes over to which column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// The track, from 0 at the top.
    pub track: i32,
    /// The column to which it leads, in cells.
    pub column: i32,
}

/// The ways of all lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Channel {
    /// For each line its turns, downwards; none for a line that is straight.
    pub turns: Vec<Vec<Turn>>,
    /// Tracks used.
    pub tracks: i32,
}

/// A stretch along a track, from one column to another, that belongs to a line.
struct Stretch {
    line: usize,
    from: i32,
    to: i32,
}

/// Leads lines through a channel so that no two share a stretch of row or column.
pub fn lead(lines: &[Line]) -> Channel {
    let mut stretches = Vec::new();
    for (line, Line { top, bottom }) in lines.iter().enumerate() {
        if top != bottom {
            stretches.push(Stretch {
                line,
                from: *top,
                to: *bottom,
            });
        }
    }
    // A stretch whose line comes down a column must lie above the one whose line leaves by that
    // column.
    let mut below = followers(&stretches);
    let split = cut_circles(&mut stretches, &mut below);

    let mut waiting_for = vec![0_usize; stretches.len()];
    for after in below.iter().flatten() {
        waiting_for[*after] += 1;
    }
    // In this order lines that need not cross do not: of those to the right, the rightmost goes
    // over first.
    let mut rank: Vec<usize> = (0..stretches.len()).collect();
    rank.sort_by_key(|index| {
        let Stretch { from, to, .. } = stretches[*index];
        if to > from {
            (0, -from, *index)
        } else {
            (1, from, *index)
        }
    });
    let mut place = vec![0; stretches.len()];
    for (position, index) in rank.iter().enumerate() {
        place[*index] = position;
    }
    let mut ready: std::collections::BTreeSet<usize> = rank
        .iter()
        .filter(|index| waiting_for[**index] == 0)
        .map(|index| place[*index])
        .collect();

    let least = stretches.iter().map(|one| one.from.min(one.to)).min();
    let greatest = stretches.iter().map(|one| one.from.max(one.to)).max();
    let (Some(least), Some(greatest)) = (least, greatest) else {
        return Channel {
            turns: vec![Vec::new(); lines.len()],
            tracks: 0,
        };
    };
    let mut filled = vec![0; (greatest - least + 1) as usize];
    let mut track = vec![0; stretches.len()];
    while let Some(position) = ready.pop_first() {
        let index = rank[position];
        let Stretch { from, to, .. } = stretches[index];
        let columns = (from.min(to) - least) as usize..=(from.max(to) - least) as usize;
        let free = filled[columns.clone()].iter().max().copied().unwrap_or(0);
        track[index] = free;
        filled[columns].fill(free + 1);
        for after in &below[index] {
            waiting_for[*after] -= 1;
            if waiting_for[*after] == 0 {
                ready.insert(place[*after]);
            }
        }
    }

    let mut channel = Channel {
        turns: vec![Vec::new(); lines.len()],
        tracks: filled.iter().max().copied().unwrap_or(0),
    };
    // The second part of a line that was cut comes last in the list, and below the first.
    debug_assert!(split <= stretches.len());
    for (index, stretch) in stretches.iter().enumerate() {
        channel.turns[stretch.line].push(Turn {
            track: track[index],
            column: stretch.to,
        });
    }
    channel
}

/// For each stretch those that must lie below it.
fn followers(stretches: &[Stretch]) -> Vec<Vec<usize>> {
    let ending_at: std::collections::BTreeMap<i32, usize> = stretches
        .iter()
        .enumerate()
        .map(|(index, stretch)| (stretch.to, index))
        .collect();
    stretches
        .iter()
        .map(|stretch| ending_at.get(&stretch.from).copied().into_iter().collect())
        .collect()
}

/// Lines that change places in a circle cannot all come first: one of each circle gets a detour
/// through the odd column beside its start, which no other line uses. Gives the number of whole
/// stretches; the second parts follow them.
fn cut_circles(stretches: &mut Vec<Stretch>, below: &mut Vec<Vec<usize>>) -> usize {
    let whole = stretches.len();
    let mut walk = vec![0_usize; whole];
    for start in 0..whole {
        let mut index = start;
        while walk[index] == 0 {
            walk[index] = start + 1;
            let Some(after) = below[index].first().copied() else {
                break;
            };
            if walk[after] == start + 1 {
                // `after` closes the circle: what came before it goes before its second part
                // instead.
                let aside = stretches[after].from + 1;
                let second = Stretch {
                    line: stretches[after].line,
                    from: aside,
                    to: stretches[after].to,
                };
                stretches[after].to = aside;
                let second_index = stretches.len();
                stretches.push(second);
                below.push(Vec::new());
                below[after].push(second_index);
                below[index][0] = second_index;
                break;
            }
            index = after;
        }
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Vertical pieces and horizontal pieces of each line, to be compared with those of the others.
    fn pieces(line: Line, turns: &[Turn], tracks: i32) -> Vec<[i32; 4]> {
        let mut found = Vec::new();
        let (mut column, mut row) = (line.top, -1);
        for turn in turns {
            found.push([column, row, column, turn.track]);
            found.push([
                column.min(turn.column),
                turn.track,
                column.max(turn.column),
                turn.track,
            ]);
            (column, row) = (turn.column, turn.track);
        }
        assert_eq!(column, line.bottom);
        found.push([column, row, column, tracks]);
        found
    }

    fn assert_clean(lines: &[Line]) {
        let channel = lead(lines);
        for (first, line) in lines.iter().enumerate() {
            for second in first + 1..lines.len() {
                for one in pieces(*line, &channel.turns[first], channel.tracks) {
                    for other in pieces(lines[second], &channel.turns[second], channel.tracks) {
                        let both_upright = one[0] == one[2] && other[0] == other[2];
                        let both_level = one[1] == one[3] && other[1] == other[3];
                        let overlap = one[0] <= other[2]
                            && other[0] <= one[2]
                            && one[1] <= other[3]
                            && other[1] <= one[3];
                        assert!(
                            !(overlap && (both_upright || both_level)),
                            "{lines:?} {channel:?}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn lines_that_change_places_do_not_meet() {
        let line = |top, bottom| Line { top, bottom };
        assert_clean(&[line(0, 4), line(4, 0)]);
        assert_clean(&[line(0, 4), line(4, 8), line(8, 0)]);
        assert_clean(&[line(0, 4), line(4, 8), line(8, 12)]);
        assert_clean(&[line(0, 2), line(2, 0), line(4, 6), line(6, 4), line(8, 8)]);
    }

    #[test]
    fn any_exchange_of_columns_is_clean() {
        let mut seed = 7_u64;
        for _ in 0..300 {
            let mut bottoms: Vec<i32> = (0..9).map(|index| index * 2).collect();
            for index in (1..bottoms.len()).rev() {
                seed = seed
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                bottoms.swap(index, (seed >> 33) as usize % (index + 1));
            }
            let lines: Vec<Line> = bottoms
                .iter()
                .enumerate()
                .map(|(index, bottom)| Line {
                    top: index as i32 * 2,
                    bottom: *bottom,
                })
                .collect();
            assert_clean(&lines);
        }
    }

    #[test]
    fn parallel_ways_across_do_not_cross() {
        // Both go right; the right one goes over above the left one.
        let channel = lead(&[Line { top: 0, bottom: 10 }, Line { top: 4, bottom: 14 }]);
        assert!(channel.turns[1][0].track < channel.turns[0][0].track);
    }
}
