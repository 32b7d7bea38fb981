//! Plane geometry of worlds: points, wall segments, circles, outlines. Lengths in metres, `f64`,
//! `libm` only.

/// A point of the plane, in metres.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Point {
    /// Towards the right of the map.
    pub x_m: f64,
    /// Towards the top of the map.
    pub y_m: f64,
}

impl Point {
    /// The point (`x_m`, `y_m`).
    pub const fn new(x_m: f64, y_m: f64) -> Self {
        Self { x_m, y_m }
    }

    /// Square of the distance to `other`, in m².
    pub fn squared_distance_m2(self, other: Self) -> f64 {
        let (x_m, y_m) = (other.x_m - self.x_m, other.y_m - self.y_m);
        x_m * x_m + y_m * y_m
    }
}

/// A straight piece of wall without thickness. Its ends differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// One end.
    pub from: Point,
    /// The other end.
    pub to: Point,
}

/// A circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub centre: Point,
    /// Its radius, in metres; above 0.
    pub radius_m: f64,
}

/// Where a ray meets a wall or a circle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the ray's origin, in metres.
    pub distance_m: f64,
    /// Cosine of the angle between the ray and the normal of what it meets: 1 for a ray straight at
    /// it, 0 for one along it.
    pub incidence_cos: f64,
}

impl Segment {
    /// Square of the shortest distance from `point`, in m².
    pub fn squared_distance_m2(&self, point: Point) -> f64 {
        point.squared_distance_m2(self.nearest_to(point))
    }

    /// Its point that is nearest to `point`.
    pub fn nearest_to(&self, point: Point) -> Point {
        let (along_x, along_y) = (self.to.x_m - self.from.x_m, self.to.y_m - self.from.y_m);
        let (x_m, y_m) = (point.x_m - self.from.x_m, point.y_m - self.from.y_m);
        let share = (x_m * along_x + y_m * along_y) / (along_x * along_x + along_y * along_y);
        let share = share.clamp(0.0, 1.0);
        Point::new(
            self.from.x_m + share * along_x,
            self.from.y_m + share * along_y,
        )
    }

    /// Where the ray from `origin` along the unit vector `direction` meets the segment, if it does.
    pub fn hit_by_ray(&self, origin: Point, direction: Point) -> Option<Hit> {
        let (along_x, along_y) = (self.to.x_m - self.from.x_m, self.to.y_m - self.from.y_m);
        let cross = direction.x_m * along_y - direction.y_m * along_x;
        if cross == 0.0 {
            return None; // Parallel: a ray along a wall brings no echo.
        }
        let (x_m, y_m) = (self.from.x_m - origin.x_m, self.from.y_m - origin.y_m);
        let distance_m = (x_m * along_y - y_m * along_x) / cross;
        let share = (x_m * direction.y_m - y_m * direction.x_m) / cross;
        if distance_m < 0.0 || !(0.0..=1.0).contains(&share) {
            return None;
        }
        let length_m = libm::sqrt(along_x * along_x + along_y * along_y);
        Some(Hit {
            distance_m,
            incidence_cos: cross.abs() / length_m,
        })
    }
}

impl Circle {
    /// Distance from `point` to the circle, in metres; negative inside.
    pub fn distance_m(&self, point: Point) -> f64 {
        libm::sqrt(self.centre.squared_distance_m2(point)) - self.radius_m
    }

    /// Its point that is nearest to `point`; to its centre, that to the right of it.
    pub fn nearest_to(&self, point: Point) -> Point {
        let (x_m, y_m) = (point.x_m - self.centre.x_m, point.y_m - self.centre.y_m);
        let distance_m = libm::sqrt(x_m * x_m + y_m * y_m);
        let (x, y) = match distance_m > 0.0 {
            true => (x_m / distance_m, y_m / distance_m),
            false => (1.0, 0.0),
        };
        Point::new(
            self.centre.x_m + self.radius_m * x,
            self.centre.y_m + self.radius_m * y,
        )
    }

    /// Where the ray from `origin` along the unit vector `direction` meets the circle from outside,
    /// if it does.
    pub fn hit_by_ray(&self, origin: Point, direction: Point) -> Option<Hit> {
        let (x_m, y_m) = (self.centre.x_m - origin.x_m, self.centre.y_m - origin.y_m);
        let along_m = x_m * direction.x_m + y_m * direction.y_m;
        let aside_m = direction.x_m * y_m - direction.y_m * x_m;
        let half_chord_m2 = self.radius_m * self.radius_m - aside_m * aside_m;
        if half_chord_m2 < 0.0 {
            return None;
        }
        let half_chord_m = libm::sqrt(half_chord_m2);
        let distance_m = along_m - half_chord_m;
        (distance_m >= 0.0).then_some(Hit {
            distance_m,
            incidence_cos: half_chord_m / self.radius_m,
        })
    }
}

/// Whether `point` lies inside the closed `outline` (even-odd rule).
pub fn is_inside(outline: &[Point], point: Point) -> bool {
    let previous = outline.iter().cycle().skip(outline.len().saturating_sub(1));
    let crossings = outline
        .iter()
        .zip(previous)
        .filter(|(a, b)| {
            (a.y_m > point.y_m) != (b.y_m > point.y_m)
                && point.x_m < (b.x_m - a.x_m) * (point.y_m - a.y_m) / (b.y_m - a.y_m) + a.x_m
        })
        .count();
    crossings % 2 == 1
}

#[cfg(test)]
mod tests {
    use super::*;

    const WALL: Segment = Segment {
        from: Point::new(1.0, -1.0),
        to: Point::new(1.0, 1.0),
    };

    #[test]
    fn distance_to_a_wall_is_to_its_nearest_point() {
        for (point, expected_m2) in [
            (Point::new(0.0, 0.0), 1.0),
            (Point::new(3.0, 0.5), 4.0),
            (Point::new(1.0, 0.25), 0.0),
            (Point::new(4.0, 5.0), 25.0),
            (Point::new(1.0, -3.0), 4.0),
        ] {
            assert_eq!(WALL.squared_distance_m2(point), expected_m2, "{point:?}");
        }
    }

    #[test]
    fn a_ray_hits_what_is_before_it() {
        let diagonal = libm::sqrt(0.5);
        for (direction, expected) in [
            (Point::new(1.0, 0.0), Some((1.0, 1.0))),
            (Point::new(-1.0, 0.0), None),
            (Point::new(0.0, 1.0), None),
            (Point::new(0.6, 0.8), None),
            (Point::new(0.8, 0.6), Some((1.25, 0.8))),
            (
                Point::new(diagonal, -diagonal),
                Some((libm::sqrt(2.0), diagonal)),
            ),
        ] {
            let hit = WALL.hit_by_ray(Point::default(), direction);
            match (hit, expected) {
                (Some(hit), Some((distance_m, incidence_cos))) => {
                    assert!((hit.distance_m - distance_m).abs() < 1e-12, "{direction:?}");
                    assert!((hit.incidence_cos - incidence_cos).abs() < 1e-12);
                }
                (None, None) => {}
                _ => panic!("{direction:?}: {hit:?}, expected {expected:?}"),
            }
        }
    }

    const PILLAR: Circle = Circle {
        centre: Point::new(3.0, 0.0),
        radius_m: 1.0,
    };

    #[test]
    fn distance_to_a_circle_is_negative_inside() {
        for (point, expected_m) in [
            (Point::new(0.0, 0.0), 2.0),
            (Point::new(6.0, 4.0), 4.0),
            (Point::new(2.0, 0.0), 0.0),
            (Point::new(3.0, 0.0), -1.0),
        ] {
            assert_eq!(PILLAR.distance_m(point), expected_m, "{point:?}");
        }
    }

    #[test]
    fn the_nearest_point_of_a_circle_is_on_its_rim() {
        for (point, expected) in [
            (Point::new(0.0, 0.0), Point::new(2.0, 0.0)),
            (Point::new(3.0, 5.0), Point::new(3.0, 1.0)),
            (Point::new(3.0, -0.5), Point::new(3.0, -1.0)),
            (PILLAR.centre, Point::new(4.0, 0.0)),
        ] {
            assert_eq!(PILLAR.nearest_to(point), expected, "{point:?}");
        }
        assert_eq!(WALL.nearest_to(Point::new(4.0, 5.0)), Point::new(1.0, 1.0));
    }

    #[test]
    fn a_ray_hits_the_near_side_of_a_circle() {
        let ahead = Point::new(1.0, 0.0);
        for (origin, direction, expected) in [
            (Point::new(0.0, 0.0), ahead, Some((2.0, 1.0))),
            (Point::new(0.0, 0.6), ahead, Some((2.2, 0.8))),
            (Point::new(0.0, -0.8), ahead, Some((2.4, 0.6))),
            (Point::new(0.0, 1.0), ahead, Some((3.0, 0.0))),
            (Point::new(0.0, 1.001), ahead, None),
            (Point::new(0.0, 0.0), Point::new(-1.0, 0.0), None),
            (Point::new(0.0, 0.0), Point::new(0.0, 1.0), None),
            (
                Point::new(6.0, 4.0),
                Point::new(-0.6, -0.8),
                Some((4.0, 1.0)),
            ),
            (Point::new(5.0, 0.0), ahead, None),
            (Point::new(3.0, 0.0), ahead, None),
        ] {
            let hit = PILLAR.hit_by_ray(origin, direction);
            match (hit, expected) {
                (Some(hit), Some((distance_m, incidence_cos))) => {
                    assert!(
                        (hit.distance_m - distance_m).abs() < 1e-12,
                        "{origin:?} {hit:?}"
                    );
                    assert!(
                        (hit.incidence_cos - incidence_cos).abs() < 1e-12,
                        "{origin:?} {hit:?}"
                    );
                }
                (None, None) => {}
                _ => panic!("{origin:?} {direction:?}: {hit:?}, expected {expected:?}"),
            }
        }
    }

    #[test]
    fn inside_an_outline_with_a_notch() {
        let outline = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 1.0), (0.0, 4.0)]
            .map(|(x_m, y_m)| Point::new(x_m, y_m));
        for (x_m, y_m, expected) in [
            (2.0, 0.5, true),
            (2.0, 2.0, false),
            (0.5, 2.5, true),
            (3.5, 2.5, true),
            (5.0, 2.0, false),
            (2.0, -0.1, false),
        ] {
            assert_eq!(
                is_inside(&outline, Point::new(x_m, y_m)),
                expected,
                "{x_m} {y_m}"
            );
        }
        assert!(!is_inside(&[], Point::default()));
    }
}
