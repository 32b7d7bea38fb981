//! Obstacles: the walls of a world, what is low in it, and those of its people who stand there now.

use crate::world::{Circle, Hit, Person, Point, Segment, World};

use super::touch::Touched;

/// What stops the body. Sonars hear all of it but what is low.
#[derive(Clone, Debug)]
pub(super) struct Obstacles {
    walls: Vec<Segment>,
    low: Vec<Segment>,
    people: Vec<Visitor>,
}

/// A person, and whether that person stands there.
#[derive(Clone, Copy, Debug)]
struct Visitor {
    person: Person,
    stands: bool,
}

impl Obstacles {
    /// The obstacles of a world at time 0.
    pub fn new(world: &World) -> Self {
        let visitor = |person: &Person| Visitor {
            person: *person,
            stands: person.is_due_at(0),
        };
        Self {
            walls: world.walls.clone(),
            low: world.low.clone(),
            people: world.people.iter().map(visitor).collect(),
        }
    }

    /// The people who stand there now.
    pub fn people(&self) -> impl Iterator<Item = &Person> {
        let standing = self.people.iter().filter(|visitor| visitor.stands);
        standing.map(|visitor| &visitor.person)
    }

    /// Distance from `point` to the nearest wall, in metres.
    pub fn distance_to_walls_m(&self, point: Point) -> f64 {
        distance_to_m(&self.walls, point)
    }

    /// Distance from `point` to the nearest thing that is low, in metres.
    pub fn distance_to_low_m(&self, point: Point) -> f64 {
        distance_to_m(&self.low, point)
    }

    /// Distance from `point` to the nearest wall, low thing or person, in metres; negative inside a
    /// person.
    pub fn distance_m(&self, point: Point) -> f64 {
        let still_m = (self.distance_to_walls_m(point)).min(self.distance_to_low_m(point));
        (self.people())
            .map(|person| person.circle.distance_m(point))
            .fold(still_m, f64::min)
    }

    /// The point nearest to `point` of each obstacle that is nearer than `within_m`.
    pub fn near_points(&self, point: Point, within_m: f64) -> impl Iterator<Item = Point> {
        let pieces = self.walls.iter().chain(&self.low);
        let pieces = pieces.map(move |piece| piece.nearest_to(point));
        let people = self
            .people()
            .map(move |person| person.circle.nearest_to(point));
        let is_near =
            move |nearest: &Point| point.squared_distance_m2(*nearest) < within_m * within_m;
        pieces.chain(people).filter(is_near)
    }

    /// What is nearest to `point`; a wall, where a person is as near.
    pub fn nearest(&self, point: Point) -> Touched {
        let (wall_m, low_m) = (
            self.distance_to_walls_m(point),
            self.distance_to_low_m(point),
        );
        let walls = match low_m < wall_m {
            true => (Touched::Low, low_m),
            false => (Touched::Wall, wall_m),
        };
        let people = self.people().map(|person| {
            let touched = Touched::Person { line: person.line };
            (touched, person.circle.distance_m(point))
        });
        people.fold(walls, |a, b| if b.1 < a.1 { b } else { a }).0
    }

    /// The first wall or person, of those that sonars hear, that the ray from `origin` along the
    /// unit vector `direction` meets.
    pub fn hit_by_ray(&self, origin: Point, direction: Point) -> Option<Hit> {
        let walls = self.walls.iter();
        let walls = walls.filter_map(|wall| wall.hit_by_ray(origin, direction));
        let people = self.people();
        let people = people.filter_map(|person| person.circle.hit_by_ray(origin, direction));
        (walls.chain(people)).reduce(|a, b| if b.distance_m < a.distance_m { b } else { a })
    }

    /// Lets people step in and away at a time, in microseconds. Who is to step in where the body is
    /// waits, and steps in as soon as more than `gap_m` is free between the two.
    /// Returns whether anybody has stepped in or away, and who has stepped in.
    pub fn update(&mut self, time_us: u64, body: Circle, gap_m: f64) -> (bool, Vec<Person>) {
        let mut changed = false;
        let mut stepped_in = Vec::new();
        for Visitor { person, stands } in &mut self.people {
            let has_room = || {
                let between_m = person.circle.distance_m(body.centre) - body.radius_m;
                between_m > gap_m
            };
            let stands_now = person.is_due_at(time_us) && (*stands || has_room());
            changed |= *stands != stands_now;
            if stands_now && !*stands {
                stepped_in.push(*person);
            }
            *stands = stands_now;
        }
        (changed, stepped_in)
    }
}

/// Distance from `point` to the nearest of these pieces, in metres.
fn distance_to_m(pieces: &[Segment], point: Point) -> f64 {
    let squared_m2 = (pieces.iter())
        .map(|piece| piece.squared_distance_m2(point))
        .fold(f64::INFINITY, f64::min);
    libm::sqrt(squared_m2)
}
