//! The words that an expression is made of.

use super::ParseError;
use super::condition::Relation;
use super::literal::Number;

/// What an expression is made of.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Token<'a> {
    /// A keyword, or the path of a member.
    Word(&'a str),
    /// What stood between quotes.
    Text(String),
    Number(Number),
    /// `%0` to `%99`.
    Parameter(usize),
    Relation(Relation),
    Open,
    Close,
    End,
}

/// Cuts a text into tokens.
pub(super) struct Tokens<'a> {
    text: &'a str,
    position: usize,
}

impl<'a> Tokens<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { text, position: 0 }
    }

    /// The next token, and where it begins.
    pub(super) fn next(&mut self) -> Result<(Token<'a>, usize), ParseError> {
        let rest = self.rest().trim_start();
        self.position = self.text.len() - rest.len();
        let start = self.position;
        let Some(first) = rest.chars().next() else {
            return Ok((Token::End, start));
        };
        let token = match first {
            '(' => self.skip(1, Token::Open),
            ')' => self.skip(1, Token::Close),
            '=' | '<' | '>' | '!' => self.relation()?,
            '\'' | '`' | '"' => self.quoted(first)?,
            '%' => self.parameter()?,
            '0'..='9' | '+' | '-' | '.' => self.number()?,
            'a'..='z' | 'A'..='Z' | '_' => Token::Word(self.take_while(is_word)),
            _ => return Err(ParseError::UnexpectedCharacter(start)),
        };
        Ok((token, start))
    }

    fn relation(&mut self) -> Result<Token<'a>, ParseError> {
        const SIGNS: [(&str, Relation); 7] = [
            ("<>", Relation::NotEqual),
            ("!=", Relation::NotEqual),
            ("<=", Relation::LessOrEqual),
            (">=", Relation::GreaterOrEqual),
            ("=", Relation::Equal),
            ("<", Relation::Less),
            (">", Relation::Greater),
        ];
        let mut signs = SIGNS.into_iter();
        let rest = self.rest();
        let (sign, relation) = signs
            .find(|(sign, _)| rest.starts_with(sign))
            .ok_or(ParseError::UnexpectedCharacter(self.position))?;
        Ok(self.skip(sign.len(), Token::Relation(relation)))
    }

    /// A text; its quote stands twice for itself. Annex B has texts begin with a left or a right quote and end with a
    /// right one.
    fn quoted(&mut self, quote: char) -> Result<Token<'a>, ParseError> {
        let start = self.position;
        let ends: &[char] = match quote {
            '"' => &['"'],
            '\'' => &['\''],
            _ => &['\'', '`'],
        };
        let mut text = String::new();
        let mut rest = self.rest().get(1..).unwrap_or_default();
        loop {
            let (part, after) = rest
                .split_once(ends)
                .ok_or(ParseError::UnterminatedText(start))?;
            text.push_str(part);
            match after.strip_prefix(quote) {
                Some(more) => {
                    text.push(quote);
                    rest = more;
                }
                None => {
                    self.position = self.text.len() - after.len();
                    return Ok(Token::Text(text));
                }
            }
        }
    }

    fn parameter(&mut self) -> Result<Token<'a>, ParseError> {
        let start = self.position;
        self.position += 1;
        let digits = self.take_while(|byte| byte.is_ascii_digit());
        match digits.parse() {
            Ok(index) if digits.len() <= 2 => Ok(Token::Parameter(index)),
            _ => Err(ParseError::UnexpectedCharacter(start)),
        }
    }

    fn number(&mut self) -> Result<Token<'a>, ParseError> {
        let start = self.position;
        // A sign stands at the beginning or behind the e of an exponent.
        let mut last = b'e';
        let text = self.take_while(|byte| {
            let may_be_sign = matches!(last, b'e' | b'E');
            last = byte;
            is_word(byte) || (may_be_sign && matches!(byte, b'+' | b'-'))
        });
        let number = Number::parse(text).ok_or(ParseError::InvalidNumber(start))?;
        Ok(Token::Number(number))
    }

    fn rest(&self) -> &'a str {
        self.text.get(self.position..).unwrap_or_default()
    }

    fn skip(&mut self, len: usize, token: Token<'a>) -> Token<'a> {
        self.position += len;
        token
    }

    /// The longest run of ASCII characters that are wanted.
    fn take_while(&mut self, mut is_wanted: impl FnMut(u8) -> bool) -> &'a str {
        let rest = self.rest();
        let unwanted = rest
            .bytes()
            .position(|byte| !(byte.is_ascii() && is_wanted(byte)));
        let taken = rest.get(..unwanted.unwrap_or(rest.len()));
        let taken = taken.unwrap_or_default();
        self.position += taken.len();
        taken
    }
}

/// What a member's path is made of; the path itself is checked later.
fn is_word(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'.' | b'[' | b']')
}
