//! Unions: enums with data, encoded as a discriminator and the member that it selects.

use proc_macro2::{Literal, TokenStream};
use quote::quote;
use syn::{DataEnum, DeriveInput, Error, Fields, Ident, Type, Variant};

use crate::attributes::{Extensibility, TypeAttributes, VariantAttributes};
use crate::fields::{self, UnionField};

const DISCRIMINATORS: [&str; 8] = ["i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64"];

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    data: &DataEnum,
) -> syn::Result<TokenStream> {
    if attributes.extensibility == Extensibility::Mutable {
        return Err(Error::new_spanned(
            &input.ident,
            "unions are final or appendable here",
        ));
    }
    let discriminator = discriminator(attributes)?;
    let cases = Case::parse_all(data)?;
    let cdr_type = cdr_type_impl(input, attributes, &discriminator, &cases);
    let dds_type = crate::dds_type_impl(input, attributes, false);
    Ok(quote!(#cdr_type #dds_type))
}

/// One variant and the discriminator values that select it.
struct Case<'a> {
    ident: &'a Ident,
    member: Option<&'a Type>,
    labels: Vec<i128>,
    default: bool,
}

impl<'a> Case<'a> {
    fn parse_all(data: &'a DataEnum) -> syn::Result<Vec<Self>> {
        let mut cases: Vec<Self> = Vec::new();
        let mut next = 0;
        for variant in &data.variants {
            let case = Self::parse(variant, &mut next)?;
            let taken = |label: &i128| cases.iter().any(|other| other.labels.contains(label));
            if case.labels.iter().any(taken) {
                return Err(Error::new_spanned(variant, "another variant has this case"));
            }
            if case.default && cases.iter().any(|other| other.default) {
                return Err(Error::new_spanned(
                    variant,
                    "another variant is the default",
                ));
            }
            cases.push(case);
        }
        let unused = (0..).find(|label| cases.iter().all(|case| !case.labels.contains(label)));
        for case in cases.iter_mut().filter(|case| case.labels.is_empty()) {
            // The default: it is sent with a value that selects nothing else.
            case.labels.extend(unused);
        }
        Ok(cases)
    }

    fn parse(variant: &'a Variant, next: &mut i128) -> syn::Result<Self> {
        let attributes = VariantAttributes::parse(&variant.attrs)?;
        let member = match &variant.fields {
            Fields::Unit => None,
            Fields::Unnamed(fields) if fields.unnamed.len() == 1 => Some(&fields.unnamed[0].ty),
            Fields::Unnamed(_) | Fields::Named(_) => {
                return Err(Error::new_spanned(
                    variant,
                    "a union's variant holds nothing or one value, as in `Name(Type)`",
                ));
            }
        };
        let mut labels = attributes.cases;
        if labels.is_empty() && !attributes.default {
            labels.push(*next);
        }
        if let Some(last) = labels.last() {
            *next = last + 1;
        }
        Ok(Self {
            ident: &variant.ident,
            member,
            labels,
            default: attributes.default,
        })
    }

    fn encode(&self, discriminator: &Ident) -> TokenStream {
        let cdr = crate::cdr();
        let ident = self.ident;
        let label = self.labels.first().map(|label| literal(*label));
        let put = quote! {
            let discriminator: #discriminator = #label;
            #cdr::CdrType::encode(&discriminator, encoder)?;
        };
        match self.member {
            Some(_) => quote! {
                Self::#ident(value) => { #put #cdr::CdrType::encode(value, encoder) }
            },
            None => quote!(Self::#ident => { #put Ok(()) }),
        }
    }

    fn decode(&self) -> TokenStream {
        let labels = self.labels.iter().map(|label| literal(*label));
        let construct = self.construct(&quote!(decode(decoder)?));
        quote!(#(#labels)|* => Ok(#construct),)
    }

    fn field(&self) -> UnionField<'a> {
        UnionField {
            ident: self.ident,
            ty: self.member,
            label: self.labels.first().copied().unwrap_or_default(),
        }
    }

    /// The variant, its member from a function of `CdrType`.
    fn construct(&self, member: &TokenStream) -> TokenStream {
        let cdr = crate::cdr();
        let ident = self.ident;
        match self.member {
            Some(ty) => quote!(Self::#ident(<#ty as #cdr::CdrType>::#member)),
            None => quote!(Self::#ident),
        }
    }
}

fn cdr_type_impl(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    discriminator: &Ident,
    cases: &[Case<'_>],
) -> TokenStream {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let generics = crate::bound_generics(&input.generics);
    let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
    let extensibility = attributes.extensibility;
    let length_code = match extensibility {
        Extensibility::Final => quote!(NextInt),
        Extensibility::Appendable | Extensibility::Mutable => quote!(SharedBytes),
    };
    let encode = cases.iter().map(|case| case.encode(discriminator));
    let decode = cases.iter().map(Case::decode);
    let unknown = unknown_discriminator(cases, &attributes.type_name(ident));
    let initial = cases
        .iter()
        .find(|case| case.default)
        .or_else(|| cases.first());
    let initial = initial.map(|case| case.construct(&quote!(default_value())));
    let members = cases.iter().filter_map(|case| case.member);
    let fields: Vec<_> = cases.iter().map(Case::field).collect();
    let field_access = fields::of_union(&fields);
    quote! {
        #[automatically_derived]
        impl #impl_generics #cdr::CdrType for #ident #type_generics #where_clause {
            const MIN_SIZE: usize = #cdr::min_struct_size(
                #extensibility,
                <#discriminator as #cdr::CdrType>::MIN_SIZE,
            );
            const LENGTH_CODE: #cdr::LengthCode = #cdr::LengthCode::#length_code;

            fn encode(
                &self,
                encoder: &mut #cdr::Encoder<'_>,
            ) -> ::core::result::Result<(), #cdr::EncodeError> {
                encoder.aggregate(#extensibility, |encoder| match self { #(#encode)* })
            }

            fn decode(
                decoder: &mut #cdr::Decoder<'_>,
            ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                decoder.aggregate(#extensibility, |decoder| {
                    let discriminator: #discriminator = #cdr::CdrType::decode(decoder)?;
                    match discriminator { #(#decode)* #unknown }
                })
            }

            fn default_value() -> Self { #initial }

            fn add_key_size(size: &mut #cdr::KeySize) {
                <#discriminator as #cdr::CdrType>::add_key_size(size);
                size.add_largest(&[#(<#members as #cdr::CdrType>::add_key_size),*]);
            }

            #field_access
        }
    }
}

fn unknown_discriminator(cases: &[Case<'_>], type_name: &str) -> TokenStream {
    let cdr = crate::cdr();
    if let Some(default) = cases.iter().find(|case| case.default) {
        let construct = default.construct(&quote!(decode(decoder)?));
        return quote!(_ => Ok(#construct),);
    }
    quote! {
        other => Err(#cdr::DecodeError::UnknownDiscriminator {
            type_name: #type_name,
            value: other.into(),
        }),
    }
}

fn discriminator(attributes: &TypeAttributes) -> syn::Result<Ident> {
    if let Some(literal) = &attributes.bit_bound {
        return Err(Error::new_spanned(
            literal,
            "`bit_bound` is for enumerations; a union has a `discriminator`",
        ));
    }
    let Some(ident) = &attributes.discriminator else {
        return Ok(Ident::new("i32", proc_macro2::Span::call_site()));
    };
    if DISCRIMINATORS.iter().any(|name| ident == name) {
        return Ok(ident.clone());
    }
    Err(Error::new_spanned(
        ident,
        format!("a discriminator is one of {}", DISCRIMINATORS.join(", ")),
    ))
}

fn literal(label: i128) -> TokenStream {
    let magnitude = Literal::u128_unsuffixed(label.unsigned_abs());
    if label < 0 {
        quote!(-#magnitude)
    } else {
        quote!(#magnitude)
    }
}
