//! The path that a robot took, over the map of its world.

use super::axis;
use super::font::{self, Weight};
use crate::duration;
use crate::world::{self, World};

use super::palette::{GRID, INK, PAPER, QUIET_INK};
use super::scene::{Anchor, Colour, Point, Scene, Shape, Stroke, Text, words};

/// A map and what a robot did on it. Lengths are in metres, x to the right, y upwards.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PathPicture {
    /// Heading.
    pub title: String,
    /// What a reader should know first, such as distance and collisions; one line below the
    /// heading.
    pub facts: Vec<String>,
    /// Walls: start and end.
    pub walls: Vec<[[f32; 2]; 2]>,
    /// What is too low for sonars: start and end.
    pub low: Vec<[[f32; 2]; 2]>,
    /// Rooms, to be tinted and labelled.
    pub rooms: Vec<Room>,
    /// Lines on the floor.
    pub lines: Vec<FloorLine>,
    /// The parts of the path, one for each mission, in the order of time.
    pub legs: Vec<Leg>,
    /// People who stand there for a time.
    pub people: Vec<Person>,
    /// Where the robot touched a wall or a person.
    pub collisions: Vec<[f32; 2]>,
    /// Radius of the robot, for its outline at the end of the path; 0 for none.
    pub robot_radius_m: f32,
}

/// A room of the map.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Room {
    /// Its name; empty for none.
    pub name: String,
    /// Its corners.
    pub corners: Vec<[f32; 2]>,
}

/// A straight piece of a line on the floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FloorLine {
    /// Its ends.
    pub ends: [[f32; 2]; 2],
    /// From edge to edge, in metres.
    pub width_m: f32,
}

/// A person who stands in the way for a time.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Person {
    /// Where the person stands.
    pub centre: [f32; 2],
    /// The person's radius, in metres.
    pub radius_m: f32,
    /// When the person is to stand there, in words; empty for always.
    pub time: String,
}

impl Person {
    fn of(person: &world::Person) -> Self {
        let from = (person.from_us > 0).then(|| format!("from {}", duration::time(person.from_us)));
        let to = (person.to_us).map(|to_us| format!("to {}", duration::time(to_us)));
        let words: Vec<String> = from.into_iter().chain(to).collect();
        let centre = person.circle.centre;
        Person {
            centre: [centre.x_m as f32, centre.y_m as f32],
            radius_m: person.circle.radius_m as f32,
            time: words.join(" "),
        }
    }

    /// Opposite corners of the square around the person.
    fn corners(&self) -> [[f32; 2]; 2] {
        [-self.radius_m, self.radius_m].map(|off_m| self.centre.map(|value| value + off_m))
    }
}

/// The part of a path that one mission drove.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Leg {
    /// Name of the mission.
    pub name: String,
    /// Where the robot was, in the order of time. Samples closer together than a picture can show
    /// are left out, and so are those that are not finite.
    pub samples: Vec<PathSample>,
}

/// Where a robot was at a time.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PathSample {
    /// Time from the start of the run.
    pub t_us: u64,
    /// To the right, in metres.
    pub x_m: f32,
    /// Upwards, in metres.
    pub y_m: f32,
}

const MAP_WIDTH_MAX: f32 = 960.0;
const MAP_HEIGHT_MAX: f32 = 680.0;
/// Around the map: left for the y axis, below for the x axis and the legend, above for the
/// headings.
const LEFT: f32 = 52.0;
const RIGHT: f32 = 24.0;
const TOP: f32 = 74.0;
const BOTTOM: f32 = 80.0;
/// Around what is drawn on the map, in metres.
const MARGIN_M: f32 = 0.25;
const TICKS_MOST: usize = 14;
const TIME_MARKS_MOST: usize = 10;
/// Points of the path nearer than this to the last one drawn are left out.
const POINT_DISTANCE_LEAST: f32 = 0.6;

const WALL: Colour = Colour::opaque(0x343b45);
/// Dark enough to be a line, light enough for a path to show on it.
const FLOOR_LINE: Colour = Colour::opaque(0xb9bfc8);
/// A line never gets too thin to be seen.
const FLOOR_LINE_WIDTH_LEAST: f32 = 1.5;
const ROOM: Colour = Colour::opaque(0xf4f6f9);
const ROOM_NAME: Colour = Colour::opaque(0x93a0b0);
const PERSON: Colour = Colour::opaque(0x6b4f9e);
/// Light enough for a path to show that goes where a person has stood.
const PERSON_ALPHA: u8 = 50;
const COLLISION: Colour = Colour::opaque(0xc81e2b);
/// Told apart by eyes of all kinds (after Okabe and Ito), dark enough for a line on white.
const LEGS: [Colour; 6] = [
    Colour::opaque(0x0072b2),
    Colour::opaque(0xd55e00),
    Colour::opaque(0x00805f),
    Colour::opaque(0x9d4787),
    Colour::opaque(0x8a6d00),
    Colour::opaque(0x3a4cc0),
];

impl PathPicture {
    /// The map of a world, without any path yet.
    pub fn over(world: &World) -> Self {
        let place = |point: &world::Point| [point.x_m as f32, point.y_m as f32];
        let room = |room: &world::Room| Room {
            name: room.name.clone(),
            corners: room.outline.iter().map(place).collect(),
        };
        PathPicture {
            title: world.name.clone(),
            walls: world
                .walls
                .iter()
                .map(|wall| [place(&wall.from), place(&wall.to)])
                .collect(),
            low: world
                .low
                .iter()
                .map(|piece| [place(&piece.from), place(&piece.to)])
                .collect(),
            rooms: world.rooms.iter().map(room).collect(),
            lines: world
                .lines
                .iter()
                .map(|line| FloorLine {
                    ends: [place(&line.middle.from), place(&line.middle.to)],
                    width_m: line.width_m as f32,
                })
                .collect(),
            people: world.people.iter().map(Person::of).collect(),
            ..PathPicture::default()
        }
    }

    /// The picture, ready to become SVG or PNG.
    pub fn scene(&self) -> Scene {
        let map = Map::around(self.extent());
        let tracks = self.tracks(&map);
        let title = font::width(&self.title, 20.0, Weight::Bold);
        let facts = font::width(&self.fact_line(), 12.5, Weight::Regular);
        let content = map.width.max(title).max(facts).max(self.legend_width());
        let mut scene = Scene::new(
            LEFT + content + RIGHT,
            TOP + map.height + BOTTOM,
            &self.title,
        );
        self.headings(&mut scene);
        self.floor(&map, &mut scene);
        map.axes(&mut scene);
        self.floor_lines(&map, &mut scene);
        let mut taken = self.room_names(&map, &mut scene);
        for [from, to] in &self.walls {
            scene.line([map.place(*from), map.place(*to)], Stroke::solid(WALL, 2.6));
        }
        for [from, to] in &self.low {
            scene.line([map.place(*from), map.place(*to)], Stroke::solid(WALL, 1.0));
        }
        self.draw_people(&tracks, &map, &mut taken, &mut scene);
        for track in &tracks {
            track.line(&mut scene);
        }
        for collision in self.collisions.iter().map(|place| map.place(*place)) {
            cross(collision, &mut scene);
            taken.push(Area::around(collision, CROSS_ARM));
        }
        self.start_and_end(&tracks, &map, &mut taken, &mut scene);
        for track in &tracks {
            track.time_marks(&tracks, &mut taken, &mut scene);
        }
        self.legend(&map, &mut scene);
        scene
    }

    /// The legs as lines of the picture.
    fn tracks(&self, map: &Map) -> Vec<Track<'_>> {
        let coloured = self.legs.iter().zip(LEGS.into_iter().cycle());
        coloured
            .filter_map(|(leg, colour)| Track::of(leg, colour, map))
            .collect()
    }

    /// Everything that the map must hold: least and greatest x and y.
    fn extent(&self) -> [[f32; 2]; 2] {
        let walls = self.walls.iter().chain(&self.low).flatten().copied();
        let lines = self.lines.iter().flat_map(|line| line.ends);
        let rooms = self
            .rooms
            .iter()
            .flat_map(|room| room.corners.iter().copied());
        let samples = self
            .legs
            .iter()
            .flat_map(|leg| &leg.samples)
            .map(|sample| [sample.x_m, sample.y_m]);
        let points = walls
            .chain(rooms)
            .chain(lines)
            .chain(samples)
            .chain(self.people.iter().flat_map(Person::corners))
            .chain(self.collisions.iter().copied());
        let mut finite = points.filter(|point| point.iter().all(|value| value.is_finite()));
        let first = finite.next().unwrap_or([0.0, 0.0]);
        finite.fold([first, first], |[least, greatest], point| {
            [
                [least[0].min(point[0]), least[1].min(point[1])],
                [greatest[0].max(point[0]), greatest[1].max(point[1])],
            ]
        })
    }

    fn fact_line(&self) -> String {
        self.facts.join("  ·  ")
    }

    fn headings(&self, scene: &mut Scene) {
        scene.text(words(
            [LEFT, 32.0],
            &self.title,
            20.0,
            Weight::Bold,
            INK,
            Anchor::Start,
        ));
        scene.text(words(
            [LEFT, 54.0],
            &self.fact_line(),
            12.5,
            Weight::Regular,
            QUIET_INK,
            Anchor::Start,
        ));
    }

    fn floor(&self, map: &Map, scene: &mut Scene) {
        for room in &self.rooms {
            let corners: Vec<Point> = room
                .corners
                .iter()
                .map(|corner| map.place(*corner))
                .collect();
            scene.shapes.push(Shape::Polygon {
                corners,
                fill: Some(ROOM),
                stroke: None,
            });
        }
    }

    fn floor_lines(&self, map: &Map, scene: &mut Scene) {
        for line in &self.lines {
            let width = (line.width_m * map.scale).max(FLOOR_LINE_WIDTH_LEAST);
            scene.line(
                line.ends.map(|end| map.place(end)),
                Stroke::solid(FLOOR_LINE, width),
            );
        }
    }

    /// Writes the names of the rooms and returns the boxes that they take.
    fn room_names(&self, map: &Map, scene: &mut Scene) -> Vec<Area> {
        let mut taken = Vec::new();
        for room in &self.rooms {
            let Some(centre) = centre(&room.corners) else {
                continue;
            };
            let [x, y] = map.place(centre);
            let text = words(
                [x, y + 5.0],
                &room.name,
                14.0,
                Weight::Bold,
                ROOM_NAME,
                Anchor::Middle,
            );
            taken.push(Area::of(&text));
            scene.text(text);
        }
        taken
    }

    /// A circle for each person, labelled with the time where a label finds room: on the side where
    /// it hides the least of the path.
    fn draw_people(
        &self,
        tracks: &[Track<'_>],
        map: &Map,
        taken: &mut Vec<Area>,
        scene: &mut Scene,
    ) {
        for person in &self.people {
            let ([x, y], radius) = (map.place(person.centre), person.radius_m * map.scale);
            scene.tooltip(format!("person {}", person.time).trim_end());
            scene.circle(
                [x, y],
                radius,
                Some(PERSON.with_alpha(PERSON_ALPHA)),
                Some(Stroke::solid(PERSON, 1.4)),
            );
            if person.time.is_empty() {
                continue;
            }
            let labels = [
                ([x, y + radius + 13.0], Anchor::Middle),
                ([x, y - radius - 6.0], Anchor::Middle),
                ([x + radius + 6.0, y + 4.0], Anchor::Start),
                ([x - radius - 6.0, y + 4.0], Anchor::End),
            ]
            .map(|(at, anchor)| words(at, &person.time, 10.5, Weight::Regular, PERSON, anchor));
            let free = labels
                .into_iter()
                .filter(|text| !taken.iter().any(|area| area.meets(&Area::of(text))));
            if let Some(text) = free.min_by_key(|text| hidden_points(text, tracks)) {
                taken.push(Area::of(&text));
                scene.text(text);
            }
        }
    }

    /// A ring where the run began; the robot, looking where it last went, where it ended.
    fn start_and_end(
        &self,
        tracks: &[Track<'_>],
        map: &Map,
        taken: &mut Vec<Area>,
        scene: &mut Scene,
    ) {
        let (Some(first), Some(last)) = (tracks.first(), tracks.last()) else {
            return;
        };
        let (start, end) = (first.start.place, last.end.place);
        scene.tooltip("start");
        scene.circle(
            start,
            START_RADIUS,
            Some(PAPER),
            Some(Stroke::solid(first.colour, 2.4)),
        );
        taken.push(Area::around(start, START_RADIUS));
        let radius = self.robot_radius_m * map.scale;
        if radius > 0.0 {
            let colour = last.colour;
            scene.circle(
                end,
                radius,
                Some(colour.with_alpha(40)),
                Some(Stroke::solid(colour, 1.4)),
            );
        }
        scene.tooltip("end");
        arrow(last.end_direction(), end, last.colour, scene);
        taken.push(Area::around(end, radius.max(ARROW_LENGTH / 2.0)));
    }

    fn legend_entries(&self) -> Vec<(LegendSign, String)> {
        let coloured = self.legs.iter().zip(LEGS.into_iter().cycle());
        let mut entries: Vec<_> = coloured
            .map(|(leg, colour)| (LegendSign::Leg(colour), leg.name.clone()))
            .collect();
        if !entries.is_empty() {
            entries.push((LegendSign::Start, "start".into()));
            entries.push((LegendSign::End, "end".into()));
        }
        if !self.people.is_empty() {
            entries.push((LegendSign::Person, "person".into()));
        }
        if !self.collisions.is_empty() {
            entries.push((LegendSign::Collision, "collision".into()));
        }
        entries
    }

    fn legend_width(&self) -> f32 {
        let entries = self.legend_entries();
        let words: f32 = entries
            .iter()
            .map(|(_, name)| LEGEND_SIGN + font::width(name, 12.5, Weight::Regular))
            .sum();
        words + LEGEND_GAP * entries.len() as f32 + SCALE_BAR_ROOM
    }

    fn legend(&self, map: &Map, scene: &mut Scene) {
        let y = TOP + map.height + 58.0;
        let mut x = LEFT;
        for (sign, name) in self.legend_entries() {
            sign.draw([x, y], scene);
            scene.text(words(
                [x + LEGEND_SIGN, y + 4.5],
                &name,
                12.5,
                Weight::Regular,
                INK,
                Anchor::Start,
            ));
            x += LEGEND_SIGN + font::width(&name, 12.5, Weight::Regular) + LEGEND_GAP;
        }
        map.scale_bar(y, scene);
    }
}

const LEGEND_SIGN: f32 = 30.0;
const LEGEND_GAP: f32 = 22.0;
/// Room for the scale bar at the right of the legend.
const SCALE_BAR_ROOM: f32 = 200.0;

enum LegendSign {
    Leg(Colour),
    Start,
    End,
    Person,
    Collision,
}

impl LegendSign {
    fn draw(&self, [x, y]: Point, scene: &mut Scene) {
        match self {
            LegendSign::Leg(colour) => {
                scene.line([[x, y], [x + 22.0, y]], Stroke::solid(*colour, 2.6))
            }
            LegendSign::Start => scene.circle(
                [x + 14.0, y],
                5.5,
                Some(PAPER),
                Some(Stroke::solid(QUIET_INK, 2.4)),
            ),
            LegendSign::End => arrow([1.0, 0.0], [x + 14.0, y], QUIET_INK, scene),
            LegendSign::Person => scene.circle(
                [x + 14.0, y],
                5.5,
                Some(PERSON.with_alpha(PERSON_ALPHA)),
                Some(Stroke::solid(PERSON, 1.4)),
            ),
            LegendSign::Collision => cross([x + 14.0, y], scene),
        }
    }
}

/// How metres become places in the picture.
struct Map {
    least: [f32; 2],
    greatest: [f32; 2],
    /// Units of the picture in a metre.
    scale: f32,
    width: f32,
    height: f32,
}

impl Map {
    fn around([least, greatest]: [[f32; 2]; 2]) -> Self {
        let least = least.map(|value| value - MARGIN_M);
        let greatest = greatest.map(|value| value + MARGIN_M);
        let (width_m, height_m) = (greatest[0] - least[0], greatest[1] - least[1]);
        let scale = (MAP_WIDTH_MAX / width_m).min(MAP_HEIGHT_MAX / height_m);
        Map {
            least,
            greatest,
            scale,
            width: width_m * scale,
            height: height_m * scale,
        }
    }

    fn place(&self, [x, y]: [f32; 2]) -> Point {
        [
            LEFT + (x - self.least[0]) * self.scale,
            TOP + (self.greatest[1] - y) * self.scale,
        ]
    }

    fn axes(&self, scene: &mut Scene) {
        let (left, right, top, bottom) = (LEFT, LEFT + self.width, TOP, TOP + self.height);
        let longest = self.width.max(self.height) / self.scale;
        let step = axis::step(0.0, f64::from(longest), TICKS_MOST);
        let marks = |least: f32, greatest: f32| -> Vec<f64> {
            let (least, greatest) = (f64::from(least), f64::from(greatest));
            // The same step along both axes, so that the grid is square.
            let most = libm::ceil((greatest - least) / step).max(1.0) as usize;
            let first = libm::ceil(least / step);
            (0..=most)
                .map(|index| (first + index as f64) * step)
                .filter(|mark| *mark <= greatest)
                .collect()
        };
        for mark in marks(self.least[0], self.greatest[0]) {
            let x = self.place([mark as f32, 0.0])[0];
            scene.line([[x, top], [x, bottom]], Stroke::solid(GRID, 1.0));
            scene.text(words(
                [x, bottom + 17.0],
                &axis::number(mark),
                11.0,
                Weight::Regular,
                QUIET_INK,
                Anchor::Middle,
            ));
        }
        for mark in marks(self.least[1], self.greatest[1]) {
            let y = self.place([0.0, mark as f32])[1];
            scene.line([[left, y], [right, y]], Stroke::solid(GRID, 1.0));
            scene.text(words(
                [left - 8.0, y + 4.0],
                &axis::number(mark),
                11.0,
                Weight::Regular,
                QUIET_INK,
                Anchor::End,
            ));
        }
        scene.text(words(
            [right, bottom + 32.0],
            "x / m",
            11.0,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
        scene.text(words(
            [left - 8.0, top - 6.0],
            "y / m",
            11.0,
            Weight::Regular,
            QUIET_INK,
            Anchor::End,
        ));
    }

    fn scale_bar(&self, y: f32, scene: &mut Scene) {
        let length_m = axis::step(0.0, f64::from(self.width / self.scale), 8);
        let length = length_m as f32 * self.scale;
        let right = scene.width - RIGHT;
        let left = right - length;
        let stroke = Stroke::solid(INK, 1.6);
        scene.line([[left, y], [right, y]], stroke);
        for end in [left, right] {
            scene.line([[end, y - 4.0], [end, y + 4.0]], stroke);
        }
        let label = format!("{} m", axis::number(length_m));
        scene.text(words(
            [left - 8.0, y + 4.5],
            &label,
            12.5,
            Weight::Regular,
            INK,
            Anchor::End,
        ));
    }
}

/// A leg as a line of the picture.
struct Track<'a> {
    name: &'a str,
    colour: Colour,
    start: TrackPoint,
    end: TrackPoint,
    /// From start to end, without what the picture is too coarse to show.
    points: Vec<TrackPoint>,
}

#[derive(Clone, Copy)]
struct TrackPoint {
    t_us: u64,
    place: Point,
}

impl<'a> Track<'a> {
    /// `None` where the leg has no finite sample.
    fn of(leg: &'a Leg, colour: Colour, map: &Map) -> Option<Self> {
        let mut finite = leg
            .samples
            .iter()
            .filter(|sample| sample.x_m.is_finite() && sample.y_m.is_finite());
        let point = |sample: &PathSample| TrackPoint {
            t_us: sample.t_us,
            place: map.place([sample.x_m, sample.y_m]),
        };
        let start = point(finite.next()?);
        let (mut points, mut end) = (vec![start], start);
        let mut last_kept = start.place;
        for sample in finite {
            end = point(sample);
            if distance(last_kept, end.place) >= POINT_DISTANCE_LEAST {
                last_kept = end.place;
                points.push(end);
            }
        }
        points.push(end);
        Some(Track {
            name: &leg.name,
            colour,
            start,
            end,
            points,
        })
    }

    fn line(&self, scene: &mut Scene) {
        let places: Vec<Point> = self.points.iter().map(|point| point.place).collect();
        // Paper below the line lifts it off the grid and off its own earlier turns.
        scene.line(places.clone(), Stroke::solid(PAPER.with_alpha(200), 5.0));
        scene.tooltip(self.name);
        scene.line(places, Stroke::solid(self.colour, 2.2));
    }

    /// Which way the robot went last; to the right if it never went anywhere. Of length 1.
    fn end_direction(&self) -> [f32; 2] {
        let end = self.end.place;
        let mut behind = self
            .points
            .iter()
            .rev()
            .map(|point| (point.place, distance(point.place, end)));
        let from = behind.find(|(_, distance)| *distance > 3.0);
        from.map_or([1.0, 0.0], |(from, distance)| {
            [(end[0] - from[0]) / distance, (end[1] - from[1]) / distance]
        })
    }

    /// Dots with the robot's time, labelled where a label finds room: on the side where it hides
    /// the least of the path.
    fn time_marks(&self, tracks: &[Track<'_>], taken: &mut Vec<Area>, scene: &mut Scene) {
        let seconds = |t_us: u64| t_us as f64 / 1e6;
        let mut points = self.points.iter().peekable();
        for mark in axis::ticks(
            seconds(self.start.t_us),
            seconds(self.end.t_us),
            TIME_MARKS_MOST,
        ) {
            // The first point at or after the mark.
            while points.next_if(|point| seconds(point.t_us) < mark).is_some() {}
            let Some(point) = points.peek() else { return };
            // The start has its ring, or else the label of the leg before; a dot below a label
            // would spoil it.
            if mark <= seconds(self.start.t_us) || taken.iter().any(|area| area.holds(point.place))
            {
                continue;
            }
            let [x, y] = point.place;
            scene.circle(
                [x, y],
                2.8,
                Some(self.colour),
                Some(Stroke::solid(PAPER, 1.0)),
            );
            let label = format!("{} s", axis::number(mark));
            let sides = [
                ([x + 6.0, y - 5.0], Anchor::Start),
                ([x - 6.0, y - 5.0], Anchor::End),
                ([x + 6.0, y + 13.0], Anchor::Start),
                ([x - 6.0, y + 13.0], Anchor::End),
            ];
            let labels = sides
                .map(|(at, anchor)| words(at, &label, 10.5, Weight::Regular, self.colour, anchor));
            let free = labels
                .into_iter()
                .filter(|text| !taken.iter().any(|area| area.meets(&Area::of(text))));
            if let Some(text) = free.min_by_key(|text| hidden_points(text, tracks)) {
                taken.push(Area::of(&text));
                scene.text(text);
            }
        }
    }
}

/// How many points of the path a text would hide.
fn hidden_points(text: &Text, tracks: &[Track<'_>]) -> usize {
    let area = Area::of(text);
    tracks
        .iter()
        .flat_map(|track| &track.points)
        .filter(|point| area.holds(point.place))
        .count()
}

const START_RADIUS: f32 = 5.5;
const ARROW_LENGTH: f32 = 13.0;
const ARROW_HALF_WIDTH: f32 = 6.0;
const CROSS_ARM: f32 = 5.0;

/// A triangle around `centre` that points to `direction`, which is of length 1.
fn arrow([ahead_x, ahead_y]: [f32; 2], centre: Point, colour: Colour, scene: &mut Scene) {
    let at = |ahead: f32, aside: f32| {
        [
            centre[0] + ahead_x * ahead - ahead_y * aside,
            centre[1] + ahead_y * ahead + ahead_x * aside,
        ]
    };
    let half = ARROW_LENGTH / 2.0;
    let corners = vec![
        at(half, 0.0),
        at(-half, ARROW_HALF_WIDTH),
        at(-half, -ARROW_HALF_WIDTH),
    ];
    let stroke = Some(Stroke::solid(PAPER, 1.0));
    scene.shapes.push(Shape::Polygon {
        corners,
        fill: Some(colour),
        stroke,
    });
}

fn cross([x, y]: Point, scene: &mut Scene) {
    let stroke = Stroke::solid(COLLISION, 2.4);
    scene.line(
        [
            [x - CROSS_ARM, y - CROSS_ARM],
            [x + CROSS_ARM, y + CROSS_ARM],
        ],
        stroke,
    );
    scene.tooltip("collision");
    scene.line(
        [
            [x - CROSS_ARM, y + CROSS_ARM],
            [x + CROSS_ARM, y - CROSS_ARM],
        ],
        stroke,
    );
}

fn distance(a: Point, b: Point) -> f32 {
    libm::hypotf(a[0] - b[0], a[1] - b[1])
}

/// The middle of the corners' extent, where a label of a room of any sane shape stands well.
fn centre(corners: &[[f32; 2]]) -> Option<[f32; 2]> {
    let (first, others) = corners.split_first()?;
    let (mut least, mut greatest) = (*first, *first);
    for corner in others {
        for axis in 0..2 {
            least[axis] = least[axis].min(corner[axis]);
            greatest[axis] = greatest[axis].max(corner[axis]);
        }
    }
    Some([
        (least[0] + greatest[0]) / 2.0,
        (least[1] + greatest[1]) / 2.0,
    ])
}

/// The box that a text takes.
struct Area {
    left: f32,
    right: f32,
    top: f32,
    bottom: f32,
}

impl Area {
    fn of(text: &Text) -> Self {
        let width = font::width(&text.words, text.size, text.weight);
        let left = match text.anchor {
            Anchor::Start => text.at[0],
            Anchor::Middle => text.at[0] - width / 2.0,
            Anchor::End => text.at[0] - width,
        };
        let [_, base] = text.at;
        Area {
            left,
            right: left + width,
            top: base - text.size * 0.8,
            bottom: base + text.size * 0.25,
        }
    }

    /// The square whose middle is `centre`, `reach` to each side.
    fn around([x, y]: Point, reach: f32) -> Self {
        Area {
            left: x - reach,
            right: x + reach,
            top: y - reach,
            bottom: y + reach,
        }
    }

    fn holds(&self, [x, y]: Point) -> bool {
        self.left <= x && x <= self.right && self.top <= y && y <= self.bottom
    }

    fn meets(&self, other: &Area) -> bool {
        self.left < other.right
            && other.left < self.right
            && self.top < other.bottom
            && other.top < self.bottom
    }
}
