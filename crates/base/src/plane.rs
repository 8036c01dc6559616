//! Points and vectors in the plane.

/// A point, or the way from one to another.
pub type Point = [f64; 2];

/// `a - b`.
#[inline]
pub fn minus([ax, ay]: Point, [bx, by]: Point) -> Point {
    [ax - bx, ay - by]
}

/// The scalar product.
#[inline]
pub fn dot(a: Point, b: Point) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// `a_x b_y - a_y b_x`.
#[inline]
pub fn cross(a: Point, b: Point) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

/// The distance of two points.
#[inline]
pub fn distance(a: Point, b: Point) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The unit vector; zero for zero.
pub fn unit(a: Point) -> Point {
    let length = a[0].hypot(a[1]);
    if length > 0.0 { a.map(|v| v / length) } else { [0.0; 2] }
}

/// The least and the largest coordinates of points; infinite ones, the wrong way round, of none.
pub fn bounds<'a>(points: impl IntoIterator<Item = &'a Point>) -> [Point; 2] {
    let start = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
    points
        .into_iter()
        .fold(start, |[low, high], p| [[low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]])
}
