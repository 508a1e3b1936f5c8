//! Unions: enums with data, encoded as a discriminator and the member that it selects.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DataEnum, DeriveInput, Error, Fields, Ident, Type, Variant};

use crate::attributes::{Extensibility, TypeAttributes, VariantAttributes, idl_name};
use crate::description;
use crate::discriminator::{Discriminator, Label};
use crate::fields::{self, UnionField};

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
    let discriminator = Discriminator::parse(attributes)?;
    let cases = Case::parse_all(data, &discriminator)?;
    let cdr_type = cdr_type_impl(input, attributes, &discriminator, &cases);
    let dds_type = crate::dds_type_impl(input, attributes, &quote!(false));
    Ok(quote!(#cdr_type #dds_type))
}

/// One variant and the discriminator values that select it.
struct Case<'a> {
    ident: &'a Ident,
    member: Option<&'a Type>,
    labels: Vec<Label>,
    /// The only label is one that was made up, to send the default with.
    implicit: bool,
    default: bool,
    name: String,
    uint8: bool,
}

impl<'a> Case<'a> {
    fn parse_all(data: &'a DataEnum, discriminator: &Discriminator) -> syn::Result<Vec<Self>> {
        let mut cases: Vec<Self> = Vec::new();
        let mut next = 0;
        for variant in &data.variants {
            let case = Self::parse(variant, discriminator, &mut next)?;
            let taken = |label: &Label| cases.iter().any(|other| other.labels.contains(label));
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
        let labels = cases.iter().flat_map(|case| case.labels.clone());
        let unused = discriminator.unused(&labels.collect::<Vec<_>>());
        for case in cases.iter_mut().filter(|case| case.labels.is_empty()) {
            // The default: it is sent with a value that selects nothing else.
            case.labels.extend(unused.clone());
            case.implicit = true;
            if unused.is_none() {
                return Err(Error::new_spanned(
                    case.ident,
                    "give the default a `case` as well, which it is sent with",
                ));
            }
        }
        Ok(cases)
    }

    fn parse(
        variant: &'a Variant,
        discriminator: &Discriminator,
        next: &mut i128,
    ) -> syn::Result<Self> {
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
            if !matches!(discriminator, Discriminator::Integer(_)) {
                return Err(Error::new_spanned(
                    variant,
                    "name the value that selects it: `case = ...`",
                ));
            }
            labels.push(Label::Number(*next));
        }
        if let Some(Label::Number(last)) = labels.last() {
            *next = last + 1;
        }
        Ok(Self {
            ident: &variant.ident,
            member,
            labels,
            implicit: false,
            default: attributes.default,
            name: idl_name(attributes.name.as_ref(), &variant.ident),
            uint8: attributes.uint8,
        })
    }

    fn encode(&self, discriminator: &Discriminator) -> TokenStream {
        let cdr = crate::cdr();
        let ident = self.ident;
        let label = self.labels.first();
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

    fn definition(&self, id: u32) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let (name, default) = (&self.name, self.default);
        let member_type = description::member_type(self.member?, None, self.uint8);
        let labels = self.labels.iter().filter(|_| !self.implicit);
        let labels = labels.map(Label::object_value);
        let labels = labels.collect::<Option<Vec<_>>>()?;
        Some(quote! {
            #cdr::UnionMember {
                name: #name,
                id: #id,
                default: #default,
                labels: ::std::vec![#(#labels),*],
                member_type: #member_type,
            }
        })
    }

    fn decode(&self) -> TokenStream {
        let labels = &self.labels;
        let construct = self.construct(&quote!(decode(decoder)?));
        quote!(#(#labels)|* => Ok(#construct),)
    }

    fn field(&self) -> UnionField<'_> {
        UnionField {
            ident: self.ident,
            name: &self.name,
            ty: self.member,
            label: self.labels.first(),
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
    discriminator: &Discriminator,
    cases: &[Case<'_>],
) -> TokenStream {
    let cdr = crate::cdr();
    let ident = &input.ident;
    let generics = crate::bound_generics(&input.generics);
    let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
    let extensibility = attributes.extensibility;
    let encode = cases.iter().map(|case| case.encode(discriminator));
    let decode = cases.iter().map(Case::decode);
    let unknown = unknown_discriminator(discriminator, cases, &attributes.type_name(ident));
    let initial = cases
        .iter()
        .find(|case| case.default)
        .or_else(|| cases.first());
    let initial = initial.map(|case| case.construct(&quote!(default_value())));
    let members = cases.iter().filter_map(|case| case.member);
    let fields: Vec<_> = cases.iter().map(Case::field).collect();
    let field_access = fields::of_union(discriminator, &fields);
    let definition = definition(extensibility, discriminator, cases);
    let describe = description::function(&attributes.type_name(ident), definition.as_ref());
    quote! {
        #[automatically_derived]
        impl #impl_generics #cdr::CdrType for #ident #type_generics #where_clause {
            const MIN_SIZE: usize = #cdr::min_struct_size(
                #extensibility,
                <#discriminator as #cdr::CdrType>::MIN_SIZE,
            );

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
                    #[allow(unreachable_patterns, reason = "every value may have a member")]
                    match discriminator { #(#decode)* #unknown }
                })
            }

            fn default_value() -> Self { #initial }

            fn add_key_size(size: &mut #cdr::KeySize) {
                <#discriminator as #cdr::CdrType>::add_key_size(size);
                size.add_largest(&[#(<#members as #cdr::CdrType>::add_key_size),*]);
            }

            #field_access

            #describe
        }
    }
}

/// Members are numbered in their order. `None` where a TypeObject has no room for a label.
fn definition(
    extensibility: Extensibility,
    discriminator: &Discriminator,
    cases: &[Case<'_>],
) -> Option<TokenStream> {
    let cdr = crate::cdr();
    let members = cases
        .iter()
        .filter(|case| case.member.is_some())
        .zip(0u32..);
    let members = members.map(|(case, id)| case.definition(id));
    let members = members.collect::<Option<Vec<_>>>()?;
    Some(quote! {
        #cdr::Definition::Union {
            extensibility: #extensibility,
            discriminator: <#discriminator as #cdr::CdrType>::describe(types)?,
            members: ::std::vec![#(#members),*],
        }
    })
}

fn unknown_discriminator(
    discriminator: &Discriminator,
    cases: &[Case<'_>],
    type_name: &str,
) -> TokenStream {
    let cdr = crate::cdr();
    let number = discriminator.number();
    if let Some(default) = cases.iter().find(|case| case.default) {
        let construct = default.construct(&quote!(decode(decoder)?));
        return quote!(_ => Ok(#construct),);
    }
    quote! {
        other => Err(#cdr::DecodeError::UnknownDiscriminator {
            type_name: #type_name,
            value: #number,
        }),
    }
}
