//! Enumerations: enums without data, encoded as an integer of their bit bound.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{DataEnum, DeriveInput, Error, Ident, Variant};

use crate::attributes::{TypeAttributes, VariantAttributes, idl_name};
use crate::description;
use crate::fields;

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    data: &DataEnum,
) -> syn::Result<TokenStream> {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let type_name = attributes.type_name(ident);
    let bit_bound = bit_bound(attributes)?;
    let holder = holder(bit_bound);
    let default = default_literal(data)?;
    let definition = definition(attributes, data, bit_bound, default)?;
    let describe = description::function(&type_name, Some(&definition));
    let literals: Vec<_> = data.variants.iter().map(|variant| &variant.ident).collect();
    let first = &data.variants[0].ident;
    let initial = default.unwrap_or(first);
    let unknown = match default {
        Some(default) => quote!(Ok(Self::#default)),
        None => quote! {
            Err(#cdr::DecodeError::InvalidEnum { type_name: #type_name, value: value.into() })
        },
    };
    let names = data.variants.iter().map(literal_name);
    let names = names.collect::<syn::Result<Vec<_>>>()?;
    let field_access = fields::of_enumeration(ident, &literals, &names);
    Ok(quote! {
        #[automatically_derived]
        impl #cdr::CdrType for #ident {
            const MIN_SIZE: usize = <#holder as #cdr::CdrType>::MIN_SIZE;
            const LENGTH_CODE: #cdr::LengthCode = <#holder as #cdr::CdrType>::LENGTH_CODE;

            fn encode(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                let value = match self { #(Self::#literals => Self::#literals as #holder,)* };
                #cdr::CdrType::encode(&value, encoder)
            }

            fn decode(
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                let value: #holder = #cdr::CdrType::decode(decoder)?;
                match value {
                    #(value if value == Self::#literals as #holder => Ok(Self::#literals),)*
                    value => #unknown,
                }
            }

            fn default_value() -> Self { Self::#initial }

            fn add_key_size(size: &mut #cdr::KeySize) {
                <#holder as #cdr::CdrType>::add_key_size(size);
            }

            #field_access

            #describe
        }
    })
}

fn bit_bound(attributes: &TypeAttributes) -> syn::Result<u16> {
    let Some(literal) = &attributes.bit_bound else {
        return Ok(32);
    };
    match literal.base10_parse()? {
        bound @ 1..=32 => Ok(bound),
        _ => Err(Error::new_spanned(
            literal,
            "the bit bound of an enumeration is 1 to 32",
        )),
    }
}

/// The integer that the bit bound selects, XTypes 7.4.3.5.
fn holder(bit_bound: u16) -> Ident {
    match bit_bound {
        0..=8 => format_ident!("i8"),
        9..=16 => format_ident!("i16"),
        _ => format_ident!("i32"),
    }
}

fn definition(
    attributes: &TypeAttributes,
    data: &DataEnum,
    bit_bound: u16,
    default: Option<&Ident>,
) -> syn::Result<TokenStream> {
    let cdr = crate::cdr();
    let extensibility = attributes.extensibility;
    let literals = data.variants.iter().map(|variant| {
        let ident = &variant.ident;
        let name = literal_name(variant)?;
        let is_default = default == Some(ident);
        Ok(quote! {
            #cdr::Literal { name: #name, value: Self::#ident as i32, default: #is_default }
        })
    });
    let literals = literals.collect::<syn::Result<Vec<_>>>()?;
    Ok(quote! {
        #cdr::Definition::Enum {
            extensibility: #extensibility,
            bit_bound: #bit_bound,
            literals: ::std::vec![#(#literals),*],
        }
    })
}

fn literal_name(variant: &Variant) -> syn::Result<String> {
    let attributes = VariantAttributes::parse(&variant.attrs)?;
    Ok(idl_name(attributes.name.as_ref(), &variant.ident))
}

fn default_literal(data: &DataEnum) -> syn::Result<Option<&Ident>> {
    let mut default = None;
    for variant in &data.variants {
        let attributes = VariantAttributes::parse(&variant.attrs)?;
        if !attributes.cases.is_empty() {
            return Err(Error::new_spanned(
                variant,
                "write the value of an enumeration's literal as `Name = value`",
            ));
        }
        if attributes.default && default.replace(&variant.ident).is_some() {
            return Err(Error::new_spanned(
                variant,
                "another variant is the default",
            ));
        }
    }
    Ok(default)
}
