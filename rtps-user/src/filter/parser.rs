//! FilterExpression of DDS 1.4 annex B, by recursive descent.
//!
//! AND, OR, BETWEEN, LIKE and MATCH are keywords only where an operator can stand, so that members may have their names.

use super::condition::{Condition, Predicate, Relation};
use super::literal::{Literal, boolean};
use super::member::MemberPath;
use super::pattern::Pattern;
use super::token::{Token, Tokens};
use super::{MAX_DEPTH, MAX_LEN, MAX_PREDICATES, ParseError};

/// Parses a condition; `None` for a text that is empty.
pub(super) fn parse(text: &str, parameters: &[String]) -> Result<Option<Condition>, ParseError> {
    let of_parameters: usize = parameters.iter().map(String::len).sum();
    if text.len() + of_parameters > MAX_LEN {
        return Err(ParseError::TooLong);
    }
    if text.trim().is_empty() {
        return Ok(None);
    }
    let mut parser = Parser::new(text, parameters)?;
    let condition = parser.condition()?;
    match parser.token {
        Token::End => Ok(Some(condition)),
        _ => Err(parser.expected("AND, OR or the end")),
    }
}

struct Parser<'a> {
    tokens: Tokens<'a>,
    parameters: &'a [String],
    /// The token to look at, and where it begins.
    token: Token<'a>,
    position: usize,
    depth: usize,
    predicates: usize,
}

enum Operand {
    Member(MemberPath),
    Literal(Literal),
}

impl<'a> Parser<'a> {
    fn new(text: &'a str, parameters: &'a [String]) -> Result<Self, ParseError> {
        let mut tokens = Tokens::new(text);
        let (token, position) = tokens.next()?;
        Ok(Self {
            tokens,
            parameters,
            token,
            position,
            depth: 0,
            predicates: 0,
        })
    }

    /// Condition: one or more with OR between.
    fn condition(&mut self) -> Result<Condition, ParseError> {
        self.chain("OR", Self::conjunction, Condition::Any)
    }

    /// One or more with AND between, which binds closer.
    fn conjunction(&mut self) -> Result<Condition, ParseError> {
        self.chain("AND", Self::negation, Condition::All)
    }

    fn chain(
        &mut self,
        operator: &str,
        part: impl Fn(&mut Self) -> Result<Condition, ParseError>,
        join: impl FnOnce(Vec<Condition>) -> Condition,
    ) -> Result<Condition, ParseError> {
        let first = part(self)?;
        if !self.is_word(operator) {
            return Ok(first);
        }
        let mut conditions = vec![first];
        while self.eat_word(operator)? {
            conditions.push(part(self)?);
        }
        Ok(join(conditions))
    }

    fn negation(&mut self) -> Result<Condition, ParseError> {
        let mut is_negated = false;
        while self.eat_word("NOT")? {
            is_negated = !is_negated;
        }
        let condition = match self.token {
            Token::Open => self.parenthesized()?,
            _ => self.predicate()?,
        };
        Ok(negated_if(is_negated, condition))
    }

    fn parenthesized(&mut self) -> Result<Condition, ParseError> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(ParseError::TooDeep);
        }
        self.advance()?;
        let condition = self.condition()?;
        if self.token != Token::Close {
            return Err(self.expected("AND, OR or a closing parenthesis"));
        }
        self.advance()?;
        self.depth -= 1;
        Ok(condition)
    }

    fn predicate(&mut self) -> Result<Condition, ParseError> {
        self.predicates += 1;
        if self.predicates > MAX_PREDICATES {
            return Err(ParseError::TooManyPredicates);
        }
        let position = self.position;
        let left = self.operand()?;
        if let Token::Relation(relation) = self.token {
            self.advance()?;
            let right = self.operand()?;
            let predicate = comparison(left, relation, right, position)?;
            return Ok(Condition::Predicate(predicate));
        }
        let Operand::Member(member) = left else {
            return Err(self.expected("one of = <> < <= > >="));
        };
        let is_negated = self.eat_word("NOT")?;
        let predicate = self.range_or_pattern(member)?;
        Ok(negated_if(is_negated, Condition::Predicate(predicate)))
    }

    fn range_or_pattern(&mut self, member: MemberPath) -> Result<Predicate, ParseError> {
        if self.eat_word("BETWEEN")? {
            let low = self.literal()?;
            if !self.eat_word("AND")? {
                return Err(self.expected("AND"));
            }
            return Ok(Predicate::Between(member, low, self.literal()?));
        }
        let compile: fn(&str) -> Result<Pattern, ParseError> = if self.eat_word("LIKE")? {
            Pattern::like
        } else if self.eat_word("MATCH")? {
            Pattern::matching
        } else {
            return Err(self.expected("a comparison, BETWEEN, LIKE or MATCH"));
        };
        let position = self.position;
        let literal = self.literal()?;
        let text = literal.as_text().ok_or(ParseError::Expected {
            what: "a text",
            position,
        })?;
        Ok(Predicate::Pattern(member, compile(text)?))
    }

    fn literal(&mut self) -> Result<Literal, ParseError> {
        let position = self.position;
        match self.operand()? {
            Operand::Literal(literal) => Ok(literal),
            // The name of an enumerated literal.
            Operand::Member(path) => {
                let text = path.single().map(str::to_owned);
                text.map(Literal::text).ok_or(ParseError::Expected {
                    what: "a constant",
                    position,
                })
            }
        }
    }

    fn operand(&mut self) -> Result<Operand, ParseError> {
        let position = self.position;
        let literal = match self.advance()? {
            Token::Word(word) => match boolean(word) {
                Some(value) => Literal::boolean(value),
                None => return MemberPath::parse(word, position).map(Operand::Member),
            },
            Token::Text(text) => Literal::text(text),
            Token::Number(number) => Literal::number(number),
            Token::Parameter(index) => {
                let parameter = self.parameters.get(index);
                Literal::parameter(parameter.ok_or(ParseError::MissingParameter(index))?)
            }
            Token::Relation(_) | Token::Open | Token::Close | Token::End => {
                return Err(ParseError::Expected {
                    what: "a member or a constant",
                    position,
                });
            }
        };
        Ok(Operand::Literal(literal))
    }

    /// Goes on to the next token; gives the one that was there.
    fn advance(&mut self) -> Result<Token<'a>, ParseError> {
        let (token, position) = self.tokens.next()?;
        self.position = position;
        Ok(std::mem::replace(&mut self.token, token))
    }

    fn is_word(&self, keyword: &str) -> bool {
        matches!(self.token, Token::Word(word) if word.eq_ignore_ascii_case(keyword))
    }

    fn eat_word(&mut self, keyword: &str) -> Result<bool, ParseError> {
        let is_there = self.is_word(keyword);
        if is_there {
            self.advance()?;
        }
        Ok(is_there)
    }

    fn expected(&self, what: &'static str) -> ParseError {
        ParseError::Expected {
            what,
            position: self.position,
        }
    }
}

fn comparison(
    left: Operand,
    relation: Relation,
    right: Operand,
    position: usize,
) -> Result<Predicate, ParseError> {
    match (left, right) {
        (Operand::Member(left), Operand::Member(right)) => {
            Ok(Predicate::CompareMembers(left, relation, right))
        }
        (Operand::Member(member), Operand::Literal(literal)) => {
            Ok(Predicate::Compare(member, relation, literal))
        }
        (Operand::Literal(literal), Operand::Member(member)) => {
            Ok(Predicate::Compare(member, relation.mirrored(), literal))
        }
        (Operand::Literal(_), Operand::Literal(_)) => Err(ParseError::Expected {
            what: "a member",
            position,
        }),
    }
}

fn negated_if(is_negated: bool, condition: Condition) -> Condition {
    match is_negated {
        true => Condition::Not(Box::new(condition)),
        false => condition,
    }
}
