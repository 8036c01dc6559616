//! When an image was taken: tags of the page, and those of EXIF, which JPEG and PNG hold as a small TIFF file.

use super::{ByteLayout, Bytes, Directory};

/// The tags of a time and of the fraction of its second, the surest first: original, made digital, and of the file.
const TIMES: [(u16, u16); 3] = [(36867, 37521), (36868, 37522), (306, 37520)];
/// Where the directory of EXIF is.
const EXIF: u16 = 34665;
/// Further digits of a second say nothing.
const MOST_DIGITS: usize = 9;

/// The time in the EXIF data of a file that is no TIFF file, as [`read_time`].
pub(crate) fn taken_of_exif(data: &[u8]) -> Option<String> {
    let data = data.strip_prefix(b"Exif\0\0").unwrap_or(data);
    let file = ByteLayout::of(data).ok()?;
    let first = usize::try_from(file.number(data, file.word(), file.word())?).ok()?;
    read_time(&Directory::read(file, data, first).ok()?, data)
}

/// The time of a page, by the clock of the camera: `2024-05-01T10:11:12.25`.
pub(super) fn read_time<B: Bytes + ?Sized>(page: &Directory, bytes: &B) -> Option<String> {
    let exif = page.value(bytes, EXIF).and_then(|at| usize::try_from(at).ok());
    let exif = exif.and_then(|at| Directory::read(page.file, bytes, at).ok());
    let text = |tag| exif.iter().chain([page]).find_map(|directory| directory.text(bytes, tag));
    TIMES.into_iter().find_map(|(time, fraction)| {
        let mut time = date_and_time(&text(time)?)?;
        let digits = text(fraction).map(|digits| digits.trim().trim_end_matches('0').to_owned()).filter(|digits| {
            (1..=MOST_DIGITS).contains(&digits.len()) && digits.bytes().all(|digit| digit.is_ascii_digit())
        });
        if let Some(digits) = digits {
            time.push('.');
            time.push_str(&digits);
        }
        Some(time)
    })
}

/// `2024:05:01 10:11:12` of these files as others write it; none where it is no time, such as one of spaces or zeros.
fn date_and_time(text: &str) -> Option<String> {
    let parts: Vec<&str> = text.trim().split([':', '-', '/', ' ', 'T']).collect();
    let [year, month, day, hour, minute, second] = parts.as_slice() else { return None };
    let number = |part: &str, len: usize, most: u32| {
        let number = part.parse().ok().filter(|_| part.len() == len && part.bytes().all(|c| c.is_ascii_digit()));
        number.filter(|&number: &u32| number <= most)
    };
    let (year, month, day) = (number(year, 4, 9999)?, number(month, 2, 12)?, number(day, 2, 31)?);
    let (hour, minute, second) = (number(hour, 2, 23)?, number(minute, 2, 59)?, number(second, 2, 60)?);
    let there = year > 0 && month > 0 && day > 0;
    there.then(|| format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}"))
}

#[cfg(test)]
mod tests {
    use super::{date_and_time, taken_of_exif};

    #[test]
    fn times_are_read_and_what_is_none_is_left_out() {
        assert_eq!(date_and_time("2024:05:01 10:11:12").unwrap(), "2024-05-01T10:11:12");
        assert_eq!(date_and_time(" 2024-05-01T10:11:60 ").unwrap(), "2024-05-01T10:11:60");
        for none in [
            "0000:00:00 00:00:00",
            "    :  :     :  :  ",
            "2024:13:01 10:11:12",
            "2024:5:1 1:1:1",
            "+024:05:01 10:11:12",
            "",
        ] {
            assert_eq!(date_and_time(none), None, "{none:?}");
        }
    }

    #[test]
    fn the_time_of_exif_has_the_fraction_of_its_second_in_either_byte_order() {
        for little in [true, false] {
            let n = |value: u32, size: usize| {
                let bytes = value.to_be_bytes();
                let mut bytes = bytes[4 - size..].to_vec();
                if little {
                    bytes.reverse();
                }
                bytes
            };
            let entry = |tag, kind, count, value: Vec<u8>| {
                let mut bytes = [n(tag, 2), n(kind, 2), n(count, 4), value].concat();
                bytes.resize(12, 0);
                bytes
            };
            // A page with the time of the file and EXIF behind it.
            let mut data = if little { b"II*\0".to_vec() } else { b"MM\0*".to_vec() };
            data.extend(n(8, 4));
            data.extend([n(2, 2), entry(306, 2, 20, n(68, 4)), entry(34665, 4, 1, n(38, 4)), n(0, 4)].concat());
            data.extend(
                [n(2, 2), entry(36867, 2, 20, n(88, 4)), entry(37521, 2, 4, b"250\0".to_vec()), n(0, 4)].concat(),
            );
            assert_eq!(data.len(), 68);
            data.extend(b"2025:01:01 00:00:00\0");
            data.extend(b"2024:05:01 10:11:12\0");
            assert_eq!(taken_of_exif(&data).as_deref(), Some("2024-05-01T10:11:12.25"));
            // Cut off anywhere, it is another time or none.
            for len in 0..data.len() {
                let _ = taken_of_exif(&data[..len]);
            }
        }
    }
}
