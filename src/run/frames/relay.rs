//! How tracked frames hand on to each other while several are under way: each begins where the one before is forecast
//! to be, and is begun again should that turn out to be another field. What comes out is what one frame after the other
//! would give, bit for bit.

use crate::correlate::{History, Start};
use std::collections::BTreeMap;
use std::sync::{Arc, Condvar, Mutex, PoisonError};

/// What a frame hands on: the fields that the next one is predicted from.
#[derive(Debug, Clone)]
struct After {
    known: Arc<Known>,
    is_final: bool,
}

/// The history after a frame, and the number of that frame.
#[derive(Debug, Clone)]
pub(crate) struct Known {
    pub history: History,
    pub number: usize,
}

impl Known {
    /// What is known after frame `number`, which was found at `start`, if it was.
    fn and(&self, number: usize, start: Option<Start>) -> Self {
        let mut history = self.history.clone();
        start.into_iter().for_each(|start| history.note_field(number, start));
        Self { history, number }
    }
}

/// The baton of all frames.
#[derive(Debug)]
pub(crate) struct Relay {
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    /// By turn; the first is what is known before any frame.
    after: BTreeMap<usize, After>,
    /// Frames that somebody does.
    taken: usize,
    is_over: bool,
    /// By turn, what those who wait are woken by: each waits for the one before alone.
    waiting: BTreeMap<usize, Arc<Condvar>>,
}

impl Relay {
    pub fn new(history: History) -> Self {
        let first = After { known: Arc::new(Known { history, number: 0 }), is_final: true };
        let after = BTreeMap::from([(0, first)]);
        Self { state: Mutex::new(State { after, taken: 0, is_over: false, waiting: BTreeMap::new() }) }
    }

    /// The turn of the next frame; asked for in the order of the frames.
    pub fn turn(&self) -> Turn<'_> {
        let mut state = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        state.taken += 1;
        Turn { relay: self, at: state.taken, is_done: false }
    }
}

/// The turn of one frame. When it is dropped before its frame is done, the frames after it are over.
#[derive(Debug)]
pub(crate) struct Turn<'a> {
    relay: &'a Relay,
    at: usize,
    is_done: bool,
}

impl Turn<'_> {
    fn before(&self, mut is_wanted: impl FnMut(&After) -> bool) -> Option<Arc<Known>> {
        let mut state = self.relay.state.lock().unwrap_or_else(PoisonError::into_inner);
        let known = loop {
            if state.is_over {
                break None;
            }
            if let Some(after) = state.after.get(&(self.at - 1)).filter(|after| is_wanted(after)) {
                break Some(after.known.clone());
            }
            let moved = state.waiting.entry(self.at).or_default().clone();
            state = moved.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        state.waiting.remove(&self.at);
        known
    }

    /// Changes what this turn hands on, and wakes the one that waits for it.
    fn change(&self, change: impl FnOnce(&mut State)) {
        let mut state = self.relay.state.lock().unwrap_or_else(PoisonError::into_inner);
        change(&mut state);
        state.waiting.get(&(self.at + 1)).into_iter().for_each(|moved| moved.notify_one());
    }

    /// What is known of the frames before, as soon as there is a forecast; none when they are over.
    pub fn forecast(&self) -> Option<Arc<Known>> {
        self.before(|_| true)
    }

    /// What is known of the frames before once they are done.
    pub fn known(&self) -> Option<Arc<Known>> {
        self.before(|after| after.is_final)
    }

    /// Tells the next frame that this one, `number`, will be found at `start`.
    pub fn tell(&self, known: &Known, number: usize, start: Start) {
        let after = After { known: Arc::new(known.and(number, Some(start))), is_final: false };
        self.change(|state| _ = state.after.insert(self.at, after));
    }

    /// This frame, `number`, is done, after `known`: found at `start`, if it was. A forecast that was right stays what
    /// it is.
    pub fn end_frame(mut self, known: &Known, number: usize, start: Option<Start>) {
        let found = known.and(number, start);
        self.change(|state| {
            state.after.remove(&(self.at - 1));
            let after = state.after.remove(&self.at).filter(|after| after.known.history == found.history);
            let known = after.map_or_else(|| Arc::new(found), |after| after.known);
            state.after.insert(self.at, After { known, is_final: true });
        });
        self.is_done = true;
    }
}

impl Drop for Turn<'_> {
    fn drop(&mut self) {
        if !self.is_done {
            self.change(|state| {
                state.is_over = true;
                state.waiting.values().for_each(|moved| moved.notify_one());
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::GreyTransfer;
    use crate::field::StartFrom;

    fn at(u: f64) -> Start {
        Start::new(vec![[u, 0.0]; 4], vec![GreyTransfer::NONE])
    }

    #[test]
    fn a_forecast_that_was_right_is_what_was_known_and_one_that_was_wrong_is_not() {
        let relay = Relay::new(History::new(StartFrom::Previous));
        let (one, two, three) = (relay.turn(), relay.turn(), relay.turn());
        let first = one.known().expect("the first frame waits for nobody");
        one.tell(&first, 1, at(0.5));
        let forecast = two.forecast().expect("told");
        two.tell(&forecast, 2, at(1.0));
        let of_two = three.forecast().expect("told");
        one.end_frame(&first, 1, Some(at(0.5)));
        let known = two.known().expect("done");
        assert!(Arc::ptr_eq(&known, &forecast));
        // Frame 2 is not found after all.
        two.end_frame(&known, 2, None);
        let known = three.known().expect("done");
        assert!(!Arc::ptr_eq(&known, &of_two));
        assert_eq!(known.history, forecast.history);
        assert_eq!([known.number, of_two.number], [2, 2]);
    }

    #[test]
    fn frames_after_one_that_is_given_up_do_not_wait_for_it() {
        let relay = Relay::new(History::new(StartFrom::Previous));
        let (one, two) = (relay.turn(), relay.turn());
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| two.forecast().is_none());
            drop(one);
            assert!(waits.join().expect("a thread"));
        });
        assert!(two.known().is_none());
    }
}
