//! Worlds: the walls around the robot, the rooms they make, the lines on their floors, the people
//! who step in and away, and where the robot starts.
//!
//! A world is a text file, one entry a line; `#` starts a comment. Lengths are metres, x to the
//! right and y to the top of the map; angles are degrees, counter-clockwise from x.
//!
//! ```text
//! world cell                        # the name, once
//! start 1.0,1.5 90                  # where the robot's centre is and which way it looks, once
//! wall 0,0 3,0 3,3 0,3 0,0          # a line of walls through two points or more
//! wall 1,1 2,1 from 5 s             # one that is put there later
//! low 2,2 2.5,2 2.5,2.5             # the same, but too low for a sonar to hear
//! room cell 0,0 3,0 3,3 0,3         # a named area, three corners or more; walls are not drawn by it
//! line 0.02 1,1 2,1 2,2             # a dark line on the light floor: its width, then two points or more
//! person 2,1 0.25 from 5 s to 9 s   # somebody who stands in the way: centre, radius, when
//! ```
//!
//! A person without `from` stands there from the start, one without `to` stays. One who walks does
//! so from there on: `person 2,1 0.25 walks 4,1 4,3 at 0.3`, in metres per second. Rooms give
//! names to places and count what the robot has visited; where two overlap, the first in the file
//! counts.

mod geometry;

use std::path::PathBuf;

use crate::scenario::time::{Time, TimeError};

pub use geometry::{Circle, Hit, Point, Segment, is_inside};

/// The farthest from the origin that a coordinate may be, in metres: keeps sums of squares far from
/// any loss of precision.
pub const COORDINATE_LIMIT_M: f64 = 1_000.0;

/// The most wall segments of a world, low ones among them: each ray of each ping looks at all
/// others.
pub const WALL_LIMIT: usize = 4_096;

/// The most pieces of lines of a world: each reading of each sensor looks at all of them.
pub const LINE_LIMIT: usize = 4_096;

/// How wide a line may be, in metres: wider than a hair, narrower than the robot.
pub const LINE_WIDTH_M: core::ops::RangeInclusive<f64> = 0.001..=0.2;

/// The largest radius of a person, in metres: arms spread out.
pub const PERSON_RADIUS_LIMIT_M: f64 = 1.0;

/// The fastest that a person walks, in metres per second: in a hurry.
pub const LARGEST_WALK_M_PER_S: f64 = 2.0;

/// The most places to which a person walks.
pub const WALK_LIMIT: usize = 8;

/// The most people of a world: each ray of each ping looks at all who stand there.
pub const PERSON_LIMIT: usize = 256;

/// The most rooms of a world.
pub const ROOM_LIMIT: usize = 256;

/// A world, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct World {
    /// Its name.
    pub name: String,
    /// Where the robot starts.
    pub start: StartPose,
    /// The walls that stand from the start.
    pub walls: Vec<Segment>,
    /// Walls that are put there later, in the order of the file.
    pub later_walls: Vec<LaterWall>,
    /// What stops a robot and is too low for its sonars: doorsteps, the edges of low boxes.
    pub low: Vec<Segment>,
    /// All rooms, in the order of the file.
    pub rooms: Vec<Room>,
    /// All pieces of the lines on the floor.
    pub lines: Vec<LinePiece>,
    /// All people, in the order of the file.
    pub people: Vec<Person>,
}

/// A straight wall that is put there later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LaterWall {
    /// Where.
    pub wall: Segment,
    /// When, in microseconds of robot time.
    pub from_us: u64,
}

/// A straight piece of a dark line on the floor; its ends are round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinePiece {
    /// The middle of the line.
    pub middle: Segment,
    /// From one edge to the other, in metres.
    pub width_m: f64,
}

/// A walk: from one place to the next, in straight lines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Walk {
    points: [Point; WALK_LIMIT],
    count: usize,
    /// How fast, in metres per second.
    pub speed_m_per_s: f64,
}

impl Walk {
    /// The places, in the order in which the person comes there.
    pub fn points(&self) -> &[Point] {
        self.points.get(..self.count).unwrap_or(&[])
    }
}

/// A person: a round obstacle that stands at a place for a time, or walks from there.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Person {
    /// What of the floor the person takes.
    pub circle: Circle,
    /// When the person steps in, in microseconds of robot time; 0 for one who stands there at the
    /// start.
    pub from_us: u64,
    /// When the person steps away, later than `from_us`; none for one who stays.
    pub to_us: Option<u64>,
    /// Where the person walks once there; none for one who stands.
    pub walk: Option<Walk>,
    /// The person's line of the file, from 1.
    pub line: usize,
}

impl Person {
    /// Whether the person is to stand there at a time, in microseconds.
    pub fn is_due_at(&self, time_us: u64) -> bool {
        self.from_us <= time_us && self.to_us.is_none_or(|to_us| time_us < to_us)
    }
}

/// Where the robot's centre is at the start, and which way it looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StartPose {
    /// The centre.
    pub position: Point,
    /// Counter-clockwise from x, in degrees as written in the file.
    pub heading_deg: f64,
}

/// A named area.
#[derive(Clone, Debug, PartialEq)]
pub struct Room {
    /// Its name, unique in the world.
    pub name: String,
    /// Its corners, in order; the last is joined to the first.
    pub outline: Vec<Point>,
}

/// The smallest upright rectangle around a world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// The corner at the bottom left.
    pub min: Point,
    /// The corner at the top right.
    pub max: Point,
}

/// Why a world cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WorldError {
    /// The file could not be read.
    #[error("cannot read the world {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A line is wrong.
    #[error("line {line}: {cause}")]
    Line {
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        cause: LineError,
    },
    /// An entry that every world needs is not there.
    #[error("the world has no `{entry}` line: add one")]
    Missing {
        /// The word that starts the missing line.
        entry: &'static str,
    },
}

/// What is wrong with a line of a world file.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// The line's first word is none of the seven.
    #[error(
        "`{word}` starts no entry; a line starts with `world`, `start`, `wall`, `low`, `room`, `line` or `person`"
    )]
    UnknownEntry {
        /// The word.
        word: String,
    },
    /// The line's word must not come twice.
    #[error("a second `{entry}` line; remove one")]
    Repeated {
        /// The word.
        entry: &'static str,
    },
    /// The line has too few or too many words.
    #[error("expected `{form}`")]
    Form {
        /// What the line should look like.
        form: &'static str,
    },
    /// A word is not a point.
    #[error(
        "`{word}` is no point; write `X,Y` in metres, without blanks, at most 1000 m from the origin"
    )]
    Point {
        /// The word.
        word: String,
    },
    /// A word is not an angle.
    #[error("`{word}` is no angle; write degrees from -360 to 360")]
    Angle {
        /// The word.
        word: String,
    },
    /// A word is not a line's width.
    #[error("`{word}` is no width of a line; write metres from 0.001 to 0.2")]
    Width {
        /// The word.
        word: String,
    },
    /// A word is not a speed at which a person walks.
    #[error("`{word}` is no speed of a person; write metres per second above 0, at most 2")]
    Speed {
        /// What stands there.
        word: String,
    },
    /// A word is not a person's radius.
    #[error("`{word}` is no radius of a person; write metres above 0, at most 1")]
    Radius {
        /// The word.
        word: String,
    },
    /// What stands behind `from` or `to` is not a time.
    #[error("`{words}` is no time of a person or a wall: {cause}")]
    Time {
        /// What stands there.
        words: String,
        /// What is wrong with it.
        cause: TimeError,
    },
    /// A person is to step away before stepping in, or at the same time.
    #[error("the person steps in at {from}, but away at {to}; write a later time behind `to`")]
    NeverThere {
        /// When the person steps in.
        from: Time,
        /// When the person steps away.
        to: Time,
    },
    /// Two points of a wall or line in a row are the same.
    #[error("a {entry} from a point to itself; remove one of the two points")]
    NoLength {
        /// The word that starts the line of the file.
        entry: &'static str,
    },
    /// Two rooms have one name.
    #[error("a second room `{name}`; give it another name")]
    RoomRepeated {
        /// The name.
        name: String,
    },
    /// More walls, rooms, people or pieces of lines than a world may have.
    #[error("more than {limit} of them in one world; make the world simpler")]
    TooMany {
        /// The limit.
        limit: usize,
    },
}

const WORLD_FORM: &str = "world NAME";
const START_FORM: &str = "start X,Y HEADING_DEG";
const WALL_FORM: &str = "wall X,Y X,Y … [from TIME]";
const LOW_FORM: &str = "low X,Y X,Y …";
const ROOM_FORM: &str = "room NAME X,Y X,Y X,Y …";
const LINE_FORM: &str = "line WIDTH X,Y X,Y …";
const PERSON_FORM: &str = "person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]";

impl World {
    /// Checks a world in its text form.
    ///
    /// ```
    /// let world = esm_toolkit::world::World::parse("
    ///     world cell
    ///     start 1.0,1.5 90
    ///     wall 0,0 3,0 3,3 0,3 0,0
    ///     room cell 0,0 3,0 3,3 0,3
    /// ").unwrap();
    /// assert_eq!(world.walls.len(), 4);
    /// assert_eq!(world.room_at(world.start.position).unwrap().name, "cell");
    /// ```
    pub fn parse(text: &str) -> Result<Self, WorldError> {
        let mut draft = Draft::default();
        for (line, entry) in (1..).zip(text.lines()) {
            (draft.add(line, entry)).map_err(|cause| WorldError::Line { line, cause })?;
        }
        draft.finish()
    }

    /// The room in which `point` lies, if it lies in one.
    pub fn room_at(&self, point: Point) -> Option<&Room> {
        self.rooms
            .iter()
            .find(|room| is_inside(&room.outline, point))
    }

    /// The rectangle around walls, rooms, lines, people and start.
    pub fn bounds(&self) -> Bounds {
        let lines = self.lines.iter().map(|line| &line.middle);
        let later = self.later_walls.iter().map(|later| &later.wall);
        let solid = self.walls.iter().chain(later).chain(&self.low);
        let ends = (solid.chain(lines)).flat_map(|piece| [piece.from, piece.to]);
        let corners = self
            .rooms
            .iter()
            .flat_map(|room| room.outline.iter().copied());
        let people = self.people.iter().flat_map(|person| {
            let Circle { centre, radius_m } = person.circle;
            [-radius_m, radius_m].map(|off_m| Point::new(centre.x_m + off_m, centre.y_m + off_m))
        });
        let start = self.start.position;
        ends.chain(corners).chain(people).fold(
            Bounds {
                min: start,
                max: start,
            },
            |Bounds { min, max }, point| Bounds {
                min: Point::new(min.x_m.min(point.x_m), min.y_m.min(point.y_m)),
                max: Point::new(max.x_m.max(point.x_m), max.y_m.max(point.y_m)),
            },
        )
    }
}

/// What of a world has been read so far.
#[derive(Default)]
struct Draft {
    name: Option<String>,
    start: Option<StartPose>,
    walls: Vec<Segment>,
    later_walls: Vec<LaterWall>,
    low: Vec<Segment>,
    rooms: Vec<Room>,
    lines: Vec<LinePiece>,
    people: Vec<Person>,
}

impl Draft {
    fn add(&mut self, line: usize, text: &str) -> Result<(), LineError> {
        let entry = text.split('#').next().unwrap_or_default();
        let mut words = entry.split_whitespace();
        let Some(keyword) = words.next() else {
            return Ok(());
        };
        let words: Vec<&str> = words.collect();
        match keyword {
            "world" => self.add_name(&words),
            "start" => self.add_start(&words),
            "wall" => self.add_wall(&words),
            "low" => self.add_low(&words),
            "room" => self.add_room(&words),
            "line" => self.add_line(&words),
            "person" => self.add_person(line, &words),
            _ => Err(LineError::UnknownEntry {
                word: keyword.to_owned(),
            }),
        }
    }

    fn add_name(&mut self, words: &[&str]) -> Result<(), LineError> {
        let [name] = words else {
            return Err(LineError::Form { form: WORLD_FORM });
        };
        match self.name.replace((*name).to_owned()) {
            None => Ok(()),
            Some(_) => Err(LineError::Repeated { entry: "world" }),
        }
    }

    fn add_start(&mut self, words: &[&str]) -> Result<(), LineError> {
        let [position, heading] = words else {
            return Err(LineError::Form { form: START_FORM });
        };
        let pose = StartPose {
            position: point(position)?,
            heading_deg: angle_deg(heading)?,
        };
        match self.start.replace(pose) {
            None => Ok(()),
            Some(_) => Err(LineError::Repeated { entry: "start" }),
        }
    }

    fn add_wall(&mut self, words: &[&str]) -> Result<(), LineError> {
        let at = words.iter().position(|word| *word == "from");
        let (words, time) = words.split_at(at.unwrap_or(words.len()));
        let (from, rest) = time_behind("from", WALL_FORM, time)?;
        if !rest.is_empty() {
            return Err(LineError::Form { form: WALL_FORM });
        }
        let pieces = pieces("wall", WALL_FORM, words)?;
        match from.map_or(0, |from| from.us) {
            0 => self.walls.extend(pieces),
            from_us => (self.later_walls)
                .extend(pieces.into_iter().map(|wall| LaterWall { wall, from_us })),
        }
        self.limit_walls()
    }

    fn add_low(&mut self, words: &[&str]) -> Result<(), LineError> {
        self.low.extend(pieces("low", LOW_FORM, words)?);
        self.limit_walls()
    }

    fn limit_walls(&self) -> Result<(), LineError> {
        let count = self.walls.len() + self.later_walls.len() + self.low.len();
        limited(count, WALL_LIMIT)
    }

    fn add_line(&mut self, words: &[&str]) -> Result<(), LineError> {
        let Some((width, words)) = words.split_first() else {
            return Err(LineError::Form { form: LINE_FORM });
        };
        let width_m = width_m(width)?;
        let pieces = pieces("line", LINE_FORM, words)?.into_iter();
        self.lines
            .extend(pieces.map(|middle| LinePiece { middle, width_m }));
        limited(self.lines.len(), LINE_LIMIT)
    }

    fn add_room(&mut self, words: &[&str]) -> Result<(), LineError> {
        let Some((name, corners)) = words.split_first() else {
            return Err(LineError::Form { form: ROOM_FORM });
        };
        let outline = points(corners)?;
        if outline.len() < 3 {
            return Err(LineError::Form { form: ROOM_FORM });
        }
        if self.rooms.iter().any(|room| room.name == *name) {
            return Err(LineError::RoomRepeated {
                name: (*name).to_owned(),
            });
        }
        self.rooms.push(Room {
            name: (*name).to_owned(),
            outline,
        });
        limited(self.rooms.len(), ROOM_LIMIT)
    }

    fn add_person(&mut self, line: usize, words: &[&str]) -> Result<(), LineError> {
        let form = LineError::Form { form: PERSON_FORM };
        let [centre, radius, rest @ ..] = words else {
            return Err(form);
        };
        let circle = Circle {
            centre: point(centre)?,
            radius_m: radius_m(radius)?,
        };
        let (walk, rest) = walk(rest)?;
        let (from, rest) = time_behind("from", PERSON_FORM, rest)?;
        let (to, rest) = time_behind("to", PERSON_FORM, rest)?;
        if !rest.is_empty() {
            return Err(form);
        }
        let from = from.unwrap_or(Time { us: 0 });
        if let Some(to) = to.filter(|to| *to <= from) {
            return Err(LineError::NeverThere { from, to });
        }
        self.people.push(Person {
            circle,
            from_us: from.us,
            to_us: to.map(|to| to.us),
            walk,
            line,
        });
        limited(self.people.len(), PERSON_LIMIT)
    }

    fn finish(self) -> Result<World, WorldError> {
        let missing = |entry| WorldError::Missing { entry };
        if self.walls.is_empty() {
            return Err(missing("wall"));
        }
        Ok(World {
            name: self.name.ok_or(missing("world"))?,
            start: self.start.ok_or(missing("start"))?,
            walls: self.walls,
            later_walls: self.later_walls,
            low: self.low,
            rooms: self.rooms,
            lines: self.lines,
            people: self.people,
        })
    }
}

fn limited(count: usize, limit: usize) -> Result<(), LineError> {
    if count > limit {
        return Err(LineError::TooMany { limit });
    }
    Ok(())
}

/// The straight pieces through the points that `words` are, two at least.
fn pieces(
    entry: &'static str,
    form: &'static str,
    words: &[&str],
) -> Result<Vec<Segment>, LineError> {
    let points = points(words)?;
    if points.len() < 2 {
        return Err(LineError::Form { form });
    }
    (points.iter().zip(points.iter().skip(1)))
        .map(|(from, to)| match from == to {
            true => Err(LineError::NoLength { entry }),
            false => Ok(Segment {
                from: *from,
                to: *to,
            }),
        })
        .collect()
}

fn points(words: &[&str]) -> Result<Vec<Point>, LineError> {
    words.iter().map(|word| point(word)).collect()
}

pub(crate) fn point(word: &str) -> Result<Point, LineError> {
    let coordinate = |text: &str| {
        let value_m: f64 = text.parse().ok()?;
        (value_m.abs() <= COORDINATE_LIMIT_M).then_some(value_m)
    };
    word.split_once(',')
        .and_then(|(x, y)| Some(Point::new(coordinate(x)?, coordinate(y)?)))
        .ok_or_else(|| LineError::Point {
            word: word.to_owned(),
        })
}

fn width_m(word: &str) -> Result<f64, LineError> {
    match word.parse::<f64>() {
        Ok(width_m) if LINE_WIDTH_M.contains(&width_m) => Ok(width_m),
        _ => Err(LineError::Width {
            word: word.to_owned(),
        }),
    }
}

fn radius_m(word: &str) -> Result<f64, LineError> {
    match word.parse::<f64>() {
        Ok(radius_m) if radius_m > 0.0 && radius_m <= PERSON_RADIUS_LIMIT_M => Ok(radius_m),
        _ => Err(LineError::Radius {
            word: word.to_owned(),
        }),
    }
}

/// The walk that begins here, if one does, and what stands behind it.
fn walk<'a, 'b>(words: &'a [&'b str]) -> Result<(Option<Walk>, &'a [&'b str]), LineError> {
    let form = LineError::Form { form: PERSON_FORM };
    let ["walks", rest @ ..] = words else {
        return Ok((None, words));
    };
    let Some(count) = rest.iter().position(|word| *word == "at") else {
        return Err(form);
    };
    let (places, [_, speed, rest @ ..]) = rest.split_at(count) else {
        return Err(form);
    };
    if places.is_empty() {
        return Err(form);
    }
    limited(count, WALK_LIMIT)?;
    let mut points = [Point::new(0.0, 0.0); WALK_LIMIT];
    for (at, word) in points.iter_mut().zip(places) {
        *at = point(word)?;
    }
    let speed_m_per_s = (speed.parse().ok())
        .filter(|speed: &f64| *speed > 0.0 && *speed <= LARGEST_WALK_M_PER_S)
        .ok_or_else(|| LineError::Speed {
            word: (*speed).to_owned(),
        })?;
    let walk = Walk {
        points,
        count,
        speed_m_per_s,
    };
    Ok((Some(walk), rest))
}

/// The time behind `keyword`, in one word or two, and the words behind it. No time where the words
/// do not begin with it.
fn time_behind<'a, 'b>(
    keyword: &str,
    form: &'static str,
    words: &'a [&'b str],
) -> Result<(Option<Time>, &'a [&'b str]), LineError> {
    let (number, rest) = match words {
        [first, number, rest @ ..] if *first == keyword => (*number, rest),
        [first] if *first == keyword => return Err(LineError::Form { form }),
        _ => return Ok((None, words)),
    };
    let (words, rest) = match rest {
        [unit, rest @ ..]
            if *unit != "to" && number.ends_with(|end: char| end.is_ascii_digit()) =>
        {
            (format!("{number} {unit}"), rest)
        }
        _ => (number.to_owned(), rest),
    };
    match words.parse() {
        Ok(time) => Ok((Some(time), rest)),
        Err(cause) => Err(LineError::Time { words, cause }),
    }
}

fn angle_deg(word: &str) -> Result<f64, LineError> {
    match word.parse::<f64>() {
        Ok(angle_deg) if angle_deg.abs() <= 360.0 => Ok(angle_deg),
        _ => Err(LineError::Angle {
            word: word.to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CELL: &str = "\
world cell   # a comment
start 1,1.5 -90

wall 0,0 3,0 3,3 0,3 0,0
wall 1,1 2,1
room west 0,0 1.5,0 1.5,3 0,3
room all 0,0 3,0 3,3 0,3
line 0.02 1,2 2,2 2,3.5
person 2,1 0.25
person 2,1 0.3 from 5 s
person 2,1 0.3 to 9s   # a comment
person 2.75,1 0.5 from 1500 ms to 9 s
wall 1,1 2,1 2,2 from 5 s
";

    #[test]
    fn a_world_is_read_as_written() {
        let world = World::parse(CELL).unwrap();
        assert_eq!(world.name, "cell");
        assert_eq!(world.start.position, Point::new(1.0, 1.5));
        assert_eq!(world.start.heading_deg, -90.0);
        assert_eq!(world.walls.len(), 5);
        let later: Vec<u64> = world.later_walls.iter().map(|it| it.from_us).collect();
        assert_eq!(later, [5_000_000; 2]);
        assert_eq!(world.walls[3].to, Point::new(0.0, 0.0));
        assert_eq!(world.lines.len(), 2);
        assert_eq!(world.lines[1].middle.from, Point::new(2.0, 2.0));
        assert_eq!(world.lines[1].width_m, 0.02);
        let rooms = [
            (0.5, 1.0, Some("west")),
            (2.5, 1.0, Some("all")),
            (4.0, 1.0, None),
        ];
        for (x_m, y_m, expected) in rooms {
            let room = world.room_at(Point::new(x_m, y_m));
            assert_eq!(room.map(|room| room.name.as_str()), expected);
        }
        assert_eq!(
            world.bounds(),
            Bounds {
                min: Point::new(0.0, 0.0),
                max: Point::new(3.25, 3.5),
            }
        );
        let times = (world.people.iter()).map(|person| (person.line, person.from_us, person.to_us));
        assert_eq!(
            times.collect::<Vec<_>>(),
            [
                (9, 0, None),
                (10, 5_000_000, None),
                (11, 0, Some(9_000_000)),
                (12, 1_500_000, Some(9_000_000)),
            ]
        );
        let last = world.people[3];
        assert_eq!(last.circle.centre, Point::new(2.75, 1.0));
        assert_eq!(last.circle.radius_m, 0.5);
        for (time_us, is_due) in [
            (1_499_999, false),
            (1_500_000, true),
            (8_999_999, true),
            (9_000_000, false),
        ] {
            assert_eq!(last.is_due_at(time_us), is_due, "{time_us}");
        }
    }

    #[test]
    fn mistakes_are_reported_with_their_line() {
        for (text, expected) in [
            (
                "wal 0,0 1,1",
                "line 1: `wal` starts no entry; a line starts with `world`, `start`, `wall`, `low`, `room`, `line` or `person`",
            ),
            ("world a b", "line 1: expected `world NAME`"),
            (
                "world a\nworld b",
                "line 2: a second `world` line; remove one",
            ),
            ("start 1,1", "line 1: expected `start X,Y HEADING_DEG`"),
            (
                "start 1,1 0\n\nstart 1,1 0",
                "line 3: a second `start` line; remove one",
            ),
            (
                "start 1,1 north",
                "line 1: `north` is no angle; write degrees from -360 to 360",
            ),
            (
                "start 1,1 NaN",
                "line 1: `NaN` is no angle; write degrees from -360 to 360",
            ),
            ("wall 0,0", "line 1: expected `wall X,Y X,Y … [from TIME]`"),
            (
                "wall 0,0 1,0 from 1 s to 2 s",
                "line 1: expected `wall X,Y X,Y … [from TIME]`",
            ),
            (
                "wall from 1 s",
                "line 1: expected `wall X,Y X,Y … [from TIME]`",
            ),
            (
                "wall 0,0 1,0 1,0",
                "line 1: a wall from a point to itself; remove one of the two points",
            ),
            (
                "wall 0,0 1",
                "line 1: `1` is no point; write `X,Y` in metres, without blanks, at most 1000 m from the origin",
            ),
            (
                "wall 0,0 inf,0",
                "line 1: `inf,0` is no point; write `X,Y` in metres, without blanks, at most 1000 m from the origin",
            ),
            ("line", "line 1: expected `line WIDTH X,Y X,Y …`"),
            ("line 0.02 0,0", "line 1: expected `line WIDTH X,Y X,Y …`"),
            (
                "line 0,0 1,0",
                "line 1: `0,0` is no width of a line; write metres from 0.001 to 0.2",
            ),
            (
                "line 0.5 0,0 1,0",
                "line 1: `0.5` is no width of a line; write metres from 0.001 to 0.2",
            ),
            (
                "line 0.02 1,0 1,0",
                "line 1: a line from a point to itself; remove one of the two points",
            ),
            (
                "person 1,1 0.2 walks 2,2 at 3",
                "line 1: `3` is no speed of a person; write metres per second above 0, at most 2",
            ),
            (
                "person 1,1 0.2 walks at 1",
                "line 1: expected `person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]`",
            ),
            (
                "person 1,1",
                "line 1: expected `person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]`",
            ),
            (
                "\nperson 1 0.25",
                "line 2: `1` is no point; write `X,Y` in metres, without blanks, at most 1000 m from the origin",
            ),
            (
                "person 1,1 0",
                "line 1: `0` is no radius of a person; write metres above 0, at most 1",
            ),
            (
                "person 1,1 -0.1",
                "line 1: `-0.1` is no radius of a person; write metres above 0, at most 1",
            ),
            (
                "person 1,1 NaN",
                "line 1: `NaN` is no radius of a person; write metres above 0, at most 1",
            ),
            (
                "person 1,1 25",
                "line 1: `25` is no radius of a person; write metres above 0, at most 1",
            ),
            (
                "person 1,1 0.25 from",
                "line 1: expected `person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]`",
            ),
            (
                "person 1,1 0.25 from 5 to 9 s",
                "line 1: `5` is no time of a person or a wall: \
                 the unit is missing: write `us`, `ms` or `s` behind the number, as in `200 ms`",
            ),
            (
                "person 1,1 0.25 from 5 min",
                "line 1: `5 min` is no time of a person or a wall: the unit of a time is `us`, `ms` or `s`, as in `200 ms`",
            ),
            (
                "person 1,1 0.25 to noon",
                "line 1: `noon` is no time of a person or a wall: a time starts with a whole number, as in `200 ms`",
            ),
            (
                "person 1,1 0.25 from 5 s until 9 s",
                "line 1: expected `person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]`",
            ),
            (
                "person 1,1 0.25 to 9 s from 5 s",
                "line 1: expected `person X,Y RADIUS [walks X,Y ... at SPEED] [from TIME] [to TIME]`",
            ),
            (
                "person 1,1 0.25 from 9 s to 5 s",
                "line 1: the person steps in at 9 s, but away at 5 s; write a later time behind `to`",
            ),
            (
                "person 1,1 0.25 to 0 s",
                "line 1: the person steps in at 0 s, but away at 0 s; write a later time behind `to`",
            ),
            (
                "room a 0,0 1,0",
                "line 1: expected `room NAME X,Y X,Y X,Y …`",
            ),
            (
                "room a 0,0 1,0 1,1\nroom a 0,0 1,0 1,1",
                "line 2: a second room `a`; give it another name",
            ),
            (
                "world a\nstart 0,0 0",
                "the world has no `wall` line: add one",
            ),
            (
                "world a\nwall 0,0 1,0",
                "the world has no `start` line: add one",
            ),
            (
                "start 0,0 0\nwall 0,0 1,0",
                "the world has no `world` line: add one",
            ),
        ] {
            let error = World::parse(text).unwrap_err();
            assert_eq!(error.to_string(), expected, "{text}");
        }
    }

    #[test]
    fn a_world_has_at_most_so_many_walls_pieces_of_lines_and_people() {
        for (entry, limit) in [("wall", WALL_LIMIT), ("line 0.02", LINE_LIMIT)] {
            let corners: Vec<String> = (0..=limit + 1).map(|i| format!("{},0", i % 2)).collect();
            let text = format!("{entry} {}", corners.join(" "));
            let error = World::parse(&text).unwrap_err().to_string();
            assert!(error.contains("more than 4096"), "{error}");
        }
        let error = World::parse(&"person 1,1 0.25\n".repeat(PERSON_LIMIT + 1)).unwrap_err();
        assert!(
            error.to_string().contains("line 257: more than 256"),
            "{error}"
        );
    }
}
