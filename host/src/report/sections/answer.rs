//! The answer: the card that a report opens with.

use crate::report::card::Card;
use crate::report::html::Html;
use crate::report::{Results, SectionKind};

/// Registration.
pub const SECTION: SectionKind = SectionKind { id: "answer", title: "The answer", render };

fn render(results: &Results) -> Option<Html> {
    let mut body = Html::new();
    for card in results.all::<Card>() {
        body.push(&card.html());
    }
    (body != Html::new()).then_some(body)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_stands_first() {
        assert_eq!(super::super::SECTIONS[0].id, "answer");
        let mut results = Results::new();
        assert!(render(&results).is_none());
        results.add(Card { verdict: "Nothing is missing.".to_owned(), ..Card::default() });
        assert!(render(&results).unwrap().0.contains("Nothing is missing."));
    }
}
