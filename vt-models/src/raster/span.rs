/// One side of a triangle as `e(x, y) = e0 + dx x + dy y`, not negative inside, at pixel centres.
#[derive(Clone, Copy)]
struct Side {
    e: i64,
    dx: i64,
    dy: i64,
}

/// The pixels of a triangle, row by row, by exact integer edge functions with the top-left rule.
pub(super) struct Spans {
    sides: [Side; 3],
    left: i64,
    right: i64,
    row: i64,
    bottom: i64,
}

impl Spans {
    /// `corners` in 1/16 pixel of a buffer of this size; `None` where no pixel centre can be covered.
    pub fn new(corners: &[[i64; 2]; 3], width: usize, height: usize) -> Option<Self> {
        let [a, b, c] = *corners;
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        let (b, c) = match area {
            0 => return None,
            1.. => (b, c),
            _ => (c, b),
        };
        let low = |i: usize| (a[i].min(b[i]).min(c[i]) + 15).div_euclid(16).max(0);
        let high = |i: usize, n: usize| a[i].max(b[i]).max(c[i]).div_euclid(16).min(n as i64 - 1);
        let (left, right, top, bottom) = (low(0), high(0, width), low(1), high(1, height));
        if left > right || top > bottom {
            return None;
        }
        let side = |p: [i64; 2], q: [i64; 2]| {
            let (dx, dy) = (p[1] - q[1], q[0] - p[0]);
            // With y down and this winding, left sides rise (dx > 0) and the top side runs to the right (dy > 0).
            let owns_border = dx > 0 || (dx == 0 && dy > 0);
            let at_top = dx * -p[0] + dy * (16 * top - p[1]);
            Side { e: at_top - i64::from(!owns_border), dx: 16 * dx, dy: 16 * dy }
        };
        Some(Self { sides: [side(a, b), side(b, c), side(c, a)], left, right, row: top, bottom })
    }
}

impl Iterator for Spans {
    /// Row, first column, and the column after the last.
    type Item = (usize, usize, usize);

    fn next(&mut self) -> Option<Self::Item> {
        while self.row <= self.bottom {
            let (mut start, mut end) = (self.left, self.right);
            for s in &mut self.sides {
                let e = s.e;
                s.e += s.dy;
                // Quotients of integers below 2^53 by divisors below 2^25 round to f64 without crossing an integer.
                if s.dx > 0 {
                    if e + s.dx * start < 0 {
                        start = (((s.dx - 1 - e) as f64) / s.dx as f64) as i64;
                    }
                } else if s.dx < 0 {
                    if e + s.dx * end < 0 {
                        end = if e < 0 { -1 } else { (e as f64 / -s.dx as f64) as i64 };
                    }
                } else if e < 0 {
                    end = -1;
                }
            }
            let row = self.row as usize;
            self.row += 1;
            if start <= end {
                return Some((row, start as usize, end as usize + 1));
            }
        }
        None
    }
}
