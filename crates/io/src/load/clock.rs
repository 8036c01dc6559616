//! Clock times as cameras and machines write them.

/// Seconds of a day.
pub(super) const DAY: f64 = 86400.0;

/// Seconds of a clock time, `10:31:05.20`, behind a day (`2024-05-07 10:31:05`, `07.05.2024`, T) since 1970. It may end
/// in AM or PM, and in Z or the distance to it (`+02:00`), which is taken off.
pub fn clock_time(cell: &str) -> Option<f64> {
    let (day, clock) = match days_of(cell) {
        Some((day, clock)) => (day, clock),
        None => (0.0, cell.trim()),
    };
    let upper = clock.trim_end_matches('Z').to_ascii_uppercase();
    let (clock, half) = [("AM", 0.0), ("PM", 12.0), ("A.M.", 0.0), ("P.M.", 12.0)]
        .into_iter()
        .find_map(|(name, hours)| Some((upper.strip_suffix(name)?.trim_end(), Some(hours))))
        .unwrap_or((&upper, None));
    let (clock, offset) = match clock.rfind(['+', '-']) {
        Some(at) => (clock.get(..at)?.trim_end(), offset(clock.get(at..)?)?),
        None => (clock, 0.0),
    };
    let parts: Vec<&str> = clock.split(':').collect();
    let whole = |text: &str| text.parse::<u32>().ok().map(f64::from);
    let decimal = |text: &str| text.replacen(',', ".", 1).parse::<f64>().ok();
    let (hours, minutes, seconds) = match parts.as_slice() {
        [h, m] => (whole(h)?, whole(m)?, 0.0),
        [h, m, s] => (whole(h)?, whole(m)?, decimal(s)?),
        // Three digits behind a colon are milliseconds; two may be frames of a film.
        [h, m, s, ms] if ms.len() == 3 => (whole(h)?, whole(m)?, whole(s)? + 1e-3 * whole(ms)?),
        _ => return None,
    };
    let hours = match half {
        Some(half) if (1.0..=12.0).contains(&hours) => hours % 12.0 + half,
        Some(_) => return None,
        None => hours,
    };
    let fits = minutes < 60.0 && (0.0..61.0).contains(&seconds);
    fits.then_some(DAY * day + 3600.0 * hours + 60.0 * minutes + seconds - offset)
}

/// The distance to UTC, s: `+02:00`, `-0530`, `+02`.
fn offset(text: &str) -> Option<f64> {
    let (sign, digits) = text.split_at_checked(1)?;
    let digits = digits.replace(':', "");
    let number = |range: std::ops::Range<usize>| digits.get(range)?.parse::<u32>().ok().map(f64::from);
    let (hours, minutes) = match digits.len() {
        2 => (number(0..2)?, 0.0),
        4 => (number(0..2)?, number(2..4)?),
        _ => return None,
    };
    let seconds = 3600.0 * hours + 60.0 * minutes;
    (hours <= 14.0 && minutes < 60.0).then_some(if sign == "-" { -seconds } else { seconds })
}

/// The day before a clock time, as days since 1970, and the clock time.
pub(super) fn days_of(cell: &str) -> Option<(f64, &str)> {
    let (day, clock) = cell.trim().split_once([' ', 'T'])?;
    Some((days(day)?, clock.trim()))
}

/// Days since 1970 of `2024-05-07`, `2024/05/07` or `07.05.2024`.
fn days(text: &str) -> Option<f64> {
    let parts: Vec<i64> = text.split(['-', '/', '.']).map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let [a, month, c] = parts.as_slice() else { return None };
    // 05/07/2024 may be May or July: not guessed.
    let (year, day) = match (*a > 31, text.contains('.')) {
        (true, _) => (*a, *c),
        (false, true) => (*c, *a),
        _ => return None,
    };
    if !(1..=12).contains(month) || !(1..=31).contains(&day) || !(0..=9999).contains(&year) {
        return None;
    }
    // Days from civil, counted from March so that the leap day is the last of its year.
    let (y, m) = if *month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let era = y.div_euclid(400);
    let of_era = y - 400 * era;
    let of_year = (153 * m + 2) / 5 + day - 1;
    Some((146_097 * era + 365 * of_era + of_era / 4 - of_era / 100 + of_year - 719_468) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clock_times_count_seconds_and_days() {
        assert_eq!(clock_time("10:31:05.20"), Some(10.0 * 3600.0 + 31.0 * 60.0 + 5.2));
        assert_eq!(clock_time("10:31:05,5"), Some(10.0 * 3600.0 + 31.0 * 60.0 + 5.5));
        // date -u -d '2024-02-29 00:00:10' +%s
        assert_eq!(clock_time("2024-02-29T00:00:10Z"), Some(1_709_164_810.0));
        assert_eq!(clock_time("29.02.2024 00:00:10"), Some(1_709_164_810.0));
        for (text, hours, seconds) in [
            ("12:00:01 AM", 0.0, 1.0),
            ("12:30 p.m.", 12.0, 1800.0),
            ("3:04:05.123456 PM", 15.0, 245.123456),
            ("10:31:05:250", 10.0, 1865.25),
            ("10:00:00+02:00", 8.0, 0.0),
            ("10:00:00 -0530", 15.0, 1800.0),
            ("10:00Z", 10.0, 0.0),
        ] {
            let found = clock_time(text).unwrap_or_else(|| panic!("{text}"));
            assert!((found - 3600.0 * hours - seconds).abs() < 1e-9, "{text}: {found}");
        }
        for text in [
            "12.5",
            "10:61:00",
            "05/07/2024 10:00",
            "10:00:00:00",
            "",
            "abc",
            "5316520459965841-05-07 10:31",
            "13:00 PM",
            "0:10 AM",
            "10:00+2",
            "10:00:00+99:00",
            "-5",
            "+02:00",
        ] {
            assert_eq!(clock_time(text), None, "{text}");
        }
    }
}
