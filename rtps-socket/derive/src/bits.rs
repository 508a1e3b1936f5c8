//! Bitmasks and bitsets: structs of flags or small numbers that are one unsigned integer on the wire.

use proc_macro2::{Literal, TokenStream};
use quote::{format_ident, quote};
use syn::{DeriveInput, Error, Field, FieldsNamed, Ident, LitInt, Type};

use crate::attributes::{Bits, FieldAttributes, TypeAttributes, idl_name};
use crate::description;

const MAX_BITS: u16 = 64;

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    kind: Bits,
    fields: &FieldsNamed,
) -> syn::Result<TokenStream> {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let fields = BitField::parse_all(kind, fields)?;
    let bit_bound = bit_bound(attributes, kind, &fields)?;
    let holder = holder(bit_bound);
    let idents: Vec<_> = fields.iter().map(|field| field.ident).collect();
    let types = fields.iter().map(|field| field.ty);
    let put = fields.iter().map(|field| field.put(&holder));
    let take = fields.iter().map(BitField::take);
    let definition = definition(kind, bit_bound, &fields);
    let describe = description::function(&attributes.type_name(ident), Some(&definition));
    Ok(quote! {
        #[automatically_derived]
        impl #cdr::CdrType for #ident {
            const MIN_SIZE: usize = <#holder as #cdr::CdrType>::MIN_SIZE;
            const LENGTH_CODE: #cdr::LengthCode = <#holder as #cdr::CdrType>::LENGTH_CODE;

            fn encode(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                let mut bits: #holder = 0;
                #(#put)*
                #cdr::CdrType::encode(&bits, encoder)
            }

            fn decode(
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                let bits: #holder = #cdr::CdrType::decode(decoder)?;
                Ok(Self { #(#idents: #take,)* })
            }

            fn default_value() -> Self {
                Self { #(#idents: <#types as #cdr::CdrType>::default_value(),)* }
            }

            fn add_key_size(size: &mut #cdr::KeySize) {
                <#holder as #cdr::CdrType>::add_key_size(size);
            }

            #describe
        }
    })
}

/// A flag, or a number of some bits.
struct BitField<'a> {
    ident: &'a Ident,
    ty: &'a Type,
    kind: Ident,
    name: String,
    position: u16,
    bits: u16,
}

impl<'a> BitField<'a> {
    fn parse_all(kind: Bits, fields: &'a FieldsNamed) -> syn::Result<Vec<Self>> {
        let mut parsed: Vec<Self> = Vec::new();
        for field in &fields.named {
            let next = parsed.last().map_or(0, Self::end);
            let field = Self::parse(kind, field, next)?;
            let overlaps =
                |other: &Self| other.position < field.end() && field.position < other.end();
            if field.end() > MAX_BITS || parsed.iter().any(overlaps) {
                return Err(Error::new_spanned(
                    field.ident,
                    "bits are from 0 to 63, and each is of one field",
                ));
            }
            parsed.push(field);
        }
        Ok(parsed)
    }

    fn parse(kind: Bits, field: &'a Field, next: u16) -> syn::Result<Self> {
        let attributes = FieldAttributes::parse(&field.attrs)?;
        let ident = field.ident.as_ref().expect("named fields have names");
        let type_error = || {
            Error::new_spanned(
                &field.ty,
                "flags of a bitmask are `bool`s, fields of a bitset `bool`s or integers with `bits`",
            )
        };
        let Type::Path(path) = &field.ty else {
            return Err(type_error());
        };
        let holder = path.path.require_ident().map_err(|_| type_error())?;
        let number = |literal: &LitInt| literal.base10_parse::<u16>();
        let given = attributes.bits.as_ref().map(number).transpose()?;
        let bits = match (holder.to_string().as_str(), kind, given) {
            ("bool", _, None | Some(1)) => 1,
            ("u8" | "i8", Bits::Set, Some(bits @ 1..=8))
            | ("u16" | "i16", Bits::Set, Some(bits @ 1..=16))
            | ("u32" | "i32", Bits::Set, Some(bits @ 1..=32))
            | ("u64" | "i64", Bits::Set, Some(bits @ 1..=64)) => bits,
            _ => return Err(type_error()),
        };
        let position = attributes.position.as_ref().map(number).transpose()?;
        Ok(Self {
            ident,
            ty: &field.ty,
            kind: holder.clone(),
            name: idl_name(attributes.name.as_ref(), ident),
            position: position.unwrap_or(next),
            bits,
        })
    }

    fn end(&self) -> u16 {
        self.position.saturating_add(self.bits)
    }

    fn is_bool(&self) -> bool {
        self.kind == "bool"
    }

    /// The bits of a value, from the lowest on.
    fn mask(&self) -> Literal {
        Literal::u64_unsuffixed(u64::MAX >> (MAX_BITS - self.bits))
    }

    fn put(&self, holder: &Ident) -> TokenStream {
        let cdr = crate::cdr();
        let Self {
            ident,
            name,
            position,
            ..
        } = self;
        let mask = self.mask();
        let bits = self.bits as u8;
        if self.is_bool() {
            return quote!(bits |= (self.#ident as #holder) << #position;);
        }
        let value = self.value(&quote!(self.#ident as u64 & #mask));
        quote! {
            if #value != self.#ident {
                return Err(#cdr::EncodeError::BitsExceeded { member: #name, bits: #bits });
            }
            bits |= ((self.#ident as u64 & #mask) as #holder) << #position;
        }
    }

    fn take(&self) -> TokenStream {
        let position = self.position;
        let mask = self.mask();
        self.value(&quote!((bits as u64 >> #position) & #mask))
    }

    /// The value of the lowest bits of a `u64`, all others being 0.
    fn value(&self, bits: &TokenStream) -> TokenStream {
        let kind = &self.kind;
        if self.is_bool() {
            return quote!((#bits) != 0);
        }
        let unused = u32::from(MAX_BITS - self.bits);
        match kind.to_string().starts_with('i') {
            true => quote!(((((#bits) << #unused) as i64) >> #unused) as #kind),
            false => quote!((#bits) as #kind),
        }
    }

    fn definition(&self, kind: Bits) -> TokenStream {
        let cdr = crate::cdr();
        let Self { name, position, .. } = self;
        let bits = self.bits as u8;
        match kind {
            Bits::Mask => quote!(#cdr::Bitflag { name: #name, position: #position }),
            Bits::Set => {
                let holder = self.type_kind();
                quote! {
                    #cdr::Bitfield {
                        name: #name,
                        position: #position,
                        bits: #bits,
                        holder: #cdr::TypeKind::#holder,
                    }
                }
            }
        }
    }

    fn type_kind(&self) -> Ident {
        let name = match self.kind.to_string().as_str() {
            "bool" => "BOOLEAN",
            "u8" => "UINT8",
            "u16" => "UINT16",
            "u32" => "UINT32",
            "u64" => "UINT64",
            "i8" => "INT8",
            "i16" => "INT16",
            "i32" => "INT32",
            _ => "INT64",
        };
        format_ident!("{name}")
    }
}

/// A bitmask says how many bits it has, 32 by default; a bitset has as many as its fields.
fn bit_bound(attributes: &TypeAttributes, kind: Bits, fields: &[BitField<'_>]) -> syn::Result<u16> {
    let used = fields.iter().map(BitField::end).max().unwrap_or(0);
    let Some(literal) = &attributes.bit_bound else {
        return Ok(match kind {
            Bits::Mask => used.max(32),
            Bits::Set => used,
        });
    };
    match literal.base10_parse()? {
        bound if kind == Bits::Mask && bound >= used && (1..=MAX_BITS).contains(&bound) => {
            Ok(bound)
        }
        _ => Err(Error::new_spanned(
            literal,
            "the bit bound is of a bitmask, 1 to 64, and has room for all flags",
        )),
    }
}

/// The integer that the bit bound selects, XTypes 7.4.3.5.
fn holder(bit_bound: u16) -> Ident {
    match bit_bound {
        0..=8 => format_ident!("u8"),
        9..=16 => format_ident!("u16"),
        17..=32 => format_ident!("u32"),
        _ => format_ident!("u64"),
    }
}

fn definition(kind: Bits, bit_bound: u16, fields: &[BitField<'_>]) -> TokenStream {
    let cdr = crate::cdr();
    let fields = fields.iter().map(|field| field.definition(kind));
    match kind {
        Bits::Mask => quote! {
            #cdr::Definition::Bitmask {
                bit_bound: #bit_bound,
                flags: ::std::vec![#(#fields),*],
            }
        },
        Bits::Set => quote!(#cdr::Definition::Bitset(::std::vec![#(#fields),*])),
    }
}
