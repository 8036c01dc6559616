//! Text that fits a terminal.

/// Columns of a terminal that nobody has made wider.
pub(crate) const WIDTH: usize = 80;

/// `text` in lines of at most [`WIDTH`] columns, those after the first begun with `indent` blanks. Words are kept
/// whole.
pub(crate) fn wrapped(text: &str, indent: usize) -> String {
    let mut lines = String::new();
    let mut column = 0;
    // Blanks at the beginning, and between the columns of a table, are part of the text.
    let begin = text.len() - text.trim_start().len();
    lines.push_str(&text[..begin]);
    column += begin;
    let mut fresh = true;
    for word in text[begin..].split(' ') {
        let length = word.chars().count();
        if !fresh && column + 1 + length > WIDTH && !word.is_empty() {
            let kept = lines.trim_end().len();
            lines.truncate(kept);
            lines.push('\n');
            lines.push_str(&" ".repeat(indent));
            column = indent;
        } else if !fresh {
            lines.push(' ');
            column += 1;
        }
        lines.push_str(word);
        column += length;
        fresh = false;
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_broken_between_words_under_the_first_column_of_the_text() {
        let text = format!("noise           {}", "word ".repeat(30).trim_end());
        let broken = wrapped(&text, 16);
        let lines: Vec<&str> = broken.lines().collect();
        assert!(lines.len() == 3 && lines.iter().all(|line| line.len() <= WIDTH), "{broken}");
        assert!(lines[1].starts_with(&format!("{}word", " ".repeat(16))), "{broken}");
        assert_eq!(wrapped("  short  line", 4), "  short  line");
    }
}
