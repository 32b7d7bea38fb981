//! Obstacles: the walls of a world, what is low in it, and those of its people who stand there now.

use crate::world::{Circle, Hit, LaterWall, Person, Point, Segment, World};

use super::touch::Touched;

/// What stops the body. Sonars hear all of it but what is low.
#[derive(Clone, Debug)]
pub(super) struct Obstacles {
    walls: Vec<Segment>,
    /// Walls that are still to come.
    later_walls: Vec<LaterWall>,
    low: Vec<Segment>,
    people: Vec<Visitor>,
    /// When people were looked at last, in microseconds.
    updated_us: u64,
}

/// A person, where that person is now, and whether there at all.
#[derive(Clone, Copy, Debug)]
struct Visitor {
    person: Person,
    stands: bool,
    /// How many places of the walk are behind.
    passed: usize,
}

impl Visitor {
    /// Walks on by so much, unless the body would be nearer than `gap_m` then: the person waits
    /// until there is room. Returns whether it walked.
    fn walk(&mut self, way_m: f64, body: Circle, gap_m: f64) -> bool {
        let walk = self.person.walk.as_ref();
        let Some(goal) = walk
            .and_then(|walk| walk.points().get(self.passed))
            .copied()
        else {
            return false;
        };
        let from = self.person.circle.centre;
        let left_m = libm::hypot(goal.x_m - from.x_m, goal.y_m - from.y_m);
        let next = if left_m <= way_m {
            goal
        } else {
            let share = way_m / left_m;
            Point::new(
                from.x_m + (goal.x_m - from.x_m) * share,
                from.y_m + (goal.y_m - from.y_m) * share,
            )
        };
        let there = Circle {
            centre: next,
            ..self.person.circle
        };
        let between_m = |circle: Circle| circle.distance_m(body.centre) - body.radius_m;
        if between_m(there) <= gap_m && between_m(there) < between_m(self.person.circle) {
            return false;
        }
        self.person.circle = there;
        self.passed += usize::from(left_m <= way_m);
        true
    }
}

impl Obstacles {
    /// The obstacles of a world at time 0.
    pub fn new(world: &World) -> Self {
        let visitor = |person: &Person| Visitor {
            person: *person,
            stands: person.is_due_at(0),
            passed: 0,
        };
        Self {
            walls: world.walls.clone(),
            later_walls: world.later_walls.clone(),
            low: world.low.clone(),
            people: world.people.iter().map(visitor).collect(),
            updated_us: 0,
        }
    }

    /// The walls that stand there now and did not from the start.
    pub fn added_walls(&self, world: &World) -> &[Segment] {
        self.walls.get(world.walls.len()..).unwrap_or_default()
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

    /// Lets people step in and away at a time, in microseconds, and walls come. Who is to step in
    /// where the body is waits, and steps in as soon as more than `gap_m` is free between the two;
    /// so does a wall.
    /// Who walks goes on. Returns whether anybody has moved, and who has stepped in.
    pub fn update(&mut self, time_us: u64, body: Circle, gap_m: f64) -> (bool, Vec<Person>) {
        let mut changed = false;
        let mut stepped_in = Vec::new();
        let passed_s = time_us.saturating_sub(self.updated_us) as f64 * 1e-6;
        self.updated_us = time_us;
        let walls = &mut self.walls;
        let standing = walls.len();
        self.later_walls.retain(|later| {
            let between_m = distance_to_m(&[later.wall], body.centre) - body.radius_m;
            let comes = later.from_us <= time_us && between_m > gap_m;
            walls.extend(comes.then_some(later.wall));
            !comes
        });
        changed |= walls.len() > standing;
        for visitor in &mut self.people {
            if visitor.stands
                && let Some(walk) = visitor.person.walk
            {
                changed |= visitor.walk(walk.speed_m_per_s * passed_s, body, gap_m);
            }
            let Visitor { person, stands, .. } = visitor;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Where somebody is who walks at 0.5 m/s, and a body stands, after each second.
    fn walk(body: Point) -> Vec<Point> {
        let world = World::parse(
            "world hall\nstart 9,9 0\nwall -9,-9 9,-9\nperson 0,0 0.25 walks 1,0 1,1 at 0.5\n",
        )
        .expect("a world");
        let mut obstacles = Obstacles::new(&world);
        let body = Circle {
            centre: body,
            radius_m: 0.11,
        };
        (1..=5_000)
            .filter_map(|ms| {
                obstacles.update(ms * 1_000, body, 0.005);
                let at = obstacles.people().next()?.circle.centre;
                (ms % 1_000 == 0).then_some(at)
            })
            .collect()
    }

    #[test]
    fn who_walks_comes_to_each_place_and_stays_at_the_last() {
        let way = walk(Point::new(5.0, 5.0));
        for (at, (x_m, y_m)) in
            way.iter()
                .zip([(0.5, 0.0), (1.0, 0.0), (1.0, 0.5), (1.0, 1.0), (1.0, 1.0)])
        {
            let off_m = libm::hypot(at.x_m - x_m, at.y_m - y_m);
            assert!(off_m < 0.002, "{way:?}");
        }
    }

    #[test]
    fn who_finds_a_body_in_the_way_waits_before_it() {
        let way = walk(Point::new(0.8, 0.0));
        let gap_m = 0.8 - way[4].x_m - 0.25 - 0.11;
        assert!((0.005..0.006).contains(&gap_m), "{way:?}");
    }
}
