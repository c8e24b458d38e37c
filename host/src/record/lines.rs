//! Lines of a text file, one after the other in bounded memory, with their numbers.
//!
//! A line longer than [`LINE_LIMIT`] is an error, so that neither a binary file nor a decompression
//! bomb fills memory. The end of the lines says whether the last one was torn or the stream beneath
//! broke off.

use std::collections::VecDeque;
use std::io::{BufRead, Read};

/// Longest line accepted, bytes.
pub(super) const LINE_LIMIT: usize = 1 << 20;
/// Bytes that are read ahead at most, but for the last line.
const AHEAD: usize = 2 << 20;

/// What the next line is.
pub(super) enum Line {
    /// A whole line, without its line feed (and carriage return); `ended` says that a line feed
    /// followed it.
    Whole {
        /// A line feed followed.
        ended: bool,
    },
    /// No more lines.
    End,
    /// Longer than [`LINE_LIMIT`].
    TooLong,
    /// The stream failed within or before this line.
    Broken(std::io::Error),
}

/// Reads lines and counts them.
pub(super) struct Lines<R> {
    reader: R,
    /// Bytes of the present line.
    pub(super) bytes: Vec<u8>,
    /// Bytes of the line before it.
    pub(super) before: Vec<u8>,
    /// Number of the present line, from 1.
    pub(super) number: u64,
    /// Lines that were looked at and are still to come.
    ahead: VecDeque<(Line, Vec<u8>)>,
}

impl<R: BufRead> Lines<R> {
    pub(super) fn new(reader: R) -> Self {
        let (bytes, before) = (Vec::with_capacity(256), Vec::with_capacity(256));
        Self { reader, bytes, before, number: 0, ahead: VecDeque::new() }
    }

    /// The next lines, as many as are whole, without moving on.
    pub(super) fn look_ahead(&mut self, most: usize) -> Vec<&[u8]> {
        let whole = |line: &Line| matches!(line, Line::Whole { .. });
        let mut held: usize = self.ahead.iter().map(|(_, bytes)| bytes.len()).sum();
        while self.ahead.len() < most && held < AHEAD && self.ahead.back().is_none_or(|(line, _)| whole(line)) {
            let line = self.read();
            held += self.bytes.len();
            self.ahead.push_back((line, std::mem::take(&mut self.bytes)));
        }
        self.ahead.iter().take_while(|(line, _)| whole(line)).map(|(_, bytes)| bytes.as_slice()).collect()
    }

    /// Moves on to the next line.
    pub(super) fn advance(&mut self) -> Line {
        self.number += 1;
        std::mem::swap(&mut self.bytes, &mut self.before);
        match self.ahead.pop_front() {
            Some((line, bytes)) => {
                self.bytes = bytes;
                line
            }
            None => self.read(),
        }
    }

    fn read(&mut self) -> Line {
        self.bytes.clear();
        let got = (&mut self.reader).take(LINE_LIMIT as u64 + 1).read_until(b'\n', &mut self.bytes);
        match got {
            Err(e) => Line::Broken(e),
            Ok(0) => Line::End,
            Ok(_) => {
                let ended = self.bytes.last() == Some(&b'\n');
                if ended {
                    self.bytes.pop();
                    if self.bytes.last() == Some(&b'\r') {
                        self.bytes.pop();
                    }
                }
                if self.bytes.len() > LINE_LIMIT {
                    return Line::TooLong;
                }
                Line::Whole { ended }
            }
        }
    }
}

/// Cells of one line, as ranges into it; quoted cells are unquoted into a scratch buffer.
#[derive(Default)]
pub(super) struct Cells {
    text: Vec<u8>,
    ends: Vec<(usize, usize)>,
}

impl Cells {
    /// Splits a line at `delimiter`. A cell may be in double quotes, a doubled quote inside
    /// standing for one; blanks around a cell are dropped. Returns false where a quote does not end
    /// on its line.
    pub(super) fn split(&mut self, line: &[u8], delimiter: u8) -> bool {
        self.text.clear();
        self.ends.clear();
        self.text.extend_from_slice(line);
        let mut closed = true;
        if line.contains(&b'"') {
            closed = self.split_quoted(line, delimiter);
        } else if delimiter == b' ' {
            // Any number of blanks, and tabs among them.
            let mut from = None;
            for (i, b) in line.iter().enumerate() {
                match (b.is_ascii_whitespace(), from) {
                    (false, None) => from = Some(i),
                    (true, Some(start)) => {
                        self.ends.push((start, i));
                        from = None;
                    }
                    _ => {}
                }
            }
            self.ends.extend(from.map(|start| (start, line.len())));
        } else {
            let mut from = 0;
            for (i, &b) in line.iter().enumerate() {
                if b == delimiter {
                    self.ends.push((from, i));
                    from = i + 1;
                }
            }
            self.ends.push((from, line.len()));
        }
        closed
    }

    fn split_quoted(&mut self, line: &[u8], delimiter: u8) -> bool {
        self.text.clear();
        let (mut from, mut quoted, mut i) = (0, false, 0);
        while i < line.len() {
            let b = line[i];
            if quoted {
                if b == b'"' && line.get(i + 1) == Some(&b'"') {
                    self.text.push(b'"');
                    i += 1;
                } else if b == b'"' {
                    quoted = false;
                } else {
                    self.text.push(b);
                }
            } else if b == delimiter {
                self.ends.push((from, self.text.len()));
                from = self.text.len();
            } else if b == b'"' {
                quoted = true;
            } else {
                self.text.push(b);
            }
            i += 1;
        }
        self.ends.push((from, self.text.len()));
        !quoted
    }

    /// Number of cells.
    pub(super) fn len(&self) -> usize {
        self.ends.len()
    }

    /// Cell i, blanks around it dropped; empty where there is none.
    pub(super) fn get(&self, i: usize) -> &[u8] {
        match self.ends.get(i) {
            Some(&(from, to)) => self.text[from..to].trim_ascii(),
            None => b"",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_plain_and_quoted_cells() {
        let mut cells = Cells::default();
        assert!(cells.split(b"a, b ,,c", b','));
        assert_eq!((0..cells.len()).map(|i| cells.get(i)).collect::<Vec<_>>(), [b"a".as_slice(), b"b", b"", b"c"]);
        assert!(cells.split(b"\"x,y\",\"q\"\"q\", 3", b','));
        assert_eq!((0..cells.len()).map(|i| cells.get(i)).collect::<Vec<_>>(), [b"x,y".as_slice(), b"q\"q", b"3"]);
        assert!(!cells.split(b"\"open,1", b','));
    }

    #[test]
    fn a_line_without_end_is_cut_off() {
        let endless = std::io::BufReader::new(std::io::repeat(b'7'));
        let mut lines = Lines::new(endless);
        assert!(matches!(lines.advance(), Line::TooLong));
        assert!(lines.bytes.capacity() < 4 * LINE_LIMIT);
    }
}
