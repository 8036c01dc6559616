//! A share of a series, for one of several processes.

use std::fmt;
use std::str::FromStr;

/// Share `i` of `n`: the frames `i`, `i + n`, `i + 2 n`, ... of a series, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 1 to `n`.
    pub i: usize,
    /// Number of shares.
    pub n: usize,
}

impl Shard {
    /// Beginning of the names of locks.
    pub(crate) const LOCK: &str = "lock-shard-";

    /// Whether frame `number` (from 1) is in this share.
    pub fn has(self, number: usize) -> bool {
        (number - 1) % self.n == self.i - 1
    }

    pub(crate) fn lock_name(self) -> String {
        format!("{}{}-of-{}", Self::LOCK, self.i, self.n)
    }

    /// The share of a task of a Slurm array, by the variables that Slurm sets, read with `variable`.
    fn of_slurm(variable: impl Fn(&str) -> Option<String>) -> Result<Self, String> {
        let number = |name: &str, default: Option<usize>| match variable(name) {
            Some(text) => text.trim().parse().map_err(|_| format!("{name} is '{text}', no number")),
            None => default.ok_or_else(|| {
                format!("{name} is not set: `--shard slurm` belongs into a job that was sent with `sbatch --array`")
            }),
        };
        let (id, count) = (number("SLURM_ARRAY_TASK_ID", None)?, number("SLURM_ARRAY_TASK_COUNT", None)?);
        let (min, step) = (number("SLURM_ARRAY_TASK_MIN", Some(1))?, number("SLURM_ARRAY_TASK_STEP", Some(1))?.max(1));
        let past = id.checked_sub(min).filter(|past| past % step == 0 && past / step < count);
        past.map(|past| Self { i: past / step + 1, n: count }).ok_or_else(|| {
            format!("SLURM_ARRAY_TASK_ID {id} is not one of the {count} tasks from {min} in steps of {step}; give --shard I/N")
        })
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.i, self.n)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "slurm" {
            return Self::of_slurm(|name| std::env::var(name).ok());
        }
        let parts = text.split_once('/').and_then(|(i, n)| Some(Self { i: i.parse().ok()?, n: n.parse().ok()? }));
        parts.filter(|shard| (1..=shard.n).contains(&shard.i)).ok_or_else(|| {
            format!("'{text}' is not a share of a series; give I/N with I from 1 to N, such as 2/4, or slurm")
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shares_of_a_series_are_disjoint_and_hold_every_frame() {
        for number in 1..50 {
            let having = (1..=7).filter(|&i| Shard { i, n: 7 }.has(number)).count();
            assert_eq!(having, 1, "frame {number}");
        }
        assert!(Shard { i: 2, n: 4 }.has(2) && Shard { i: 2, n: 4 }.has(6) && !Shard { i: 2, n: 4 }.has(1));
    }

    #[test]
    fn a_share_is_read_as_it_is_written_and_others_are_refused_in_words() {
        assert_eq!("2/4".parse(), Ok(Shard { i: 2, n: 4 }));
        assert_eq!(Shard { i: 2, n: 4 }.to_string(), "2/4");
        for text in ["", "3", "0/4", "5/4", "1/0", "a/b", "-1/2", "1/2/3"] {
            assert!(text.parse::<Shard>().unwrap_err().contains("I from 1 to N"), "{text}");
        }
    }

    #[test]
    fn a_task_of_a_slurm_array_has_the_share_of_its_place_in_the_array() {
        let task = |set: &[(&str, &str)]| {
            Shard::of_slurm(|name| set.iter().find(|(key, _)| *key == name).map(|(_, value)| (*value).to_owned()))
        };
        let [id, count, min, step] =
            ["SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_STEP"];
        assert_eq!(task(&[(id, "1"), (count, "4")]), Ok(Shard { i: 1, n: 4 }));
        assert_eq!(task(&[(id, "3"), (count, "4"), (min, "0")]), Ok(Shard { i: 4, n: 4 }));
        assert_eq!(task(&[(id, "5"), (count, "3"), (min, "1"), (step, "2")]), Ok(Shard { i: 3, n: 3 }));
        assert!(task(&[]).unwrap_err().contains("sbatch --array"));
        assert!(task(&[(id, "x"), (count, "4")]).unwrap_err().contains("no number"));
        assert!(task(&[(id, "1,9"), (count, "2")]).is_err());
        assert!(task(&[(id, "9"), (count, "2"), (min, "1")]).unwrap_err().contains("--shard I/N"));
    }
}
