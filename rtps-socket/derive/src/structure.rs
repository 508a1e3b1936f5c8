//! Structs: their members in definition order, and the key members alone.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{DeriveInput, Error, Expr, FieldsNamed, Ident, Type};

use crate::attributes::{Extensibility, FieldAttributes, TypeAttributes, idl_name};
use crate::description;
use crate::fields::{self, StructField};

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    fields: &FieldsNamed,
) -> syn::Result<TokenStream> {
    if let Some(literal) = &attributes.bit_bound {
        return Err(Error::new_spanned(
            literal,
            "`bit_bound` is for enumerations",
        ));
    }
    if let Some(ident) = &attributes.discriminator {
        return Err(Error::new_spanned(ident, "`discriminator` is for unions"));
    }
    let structure = Structure::parse(attributes.extensibility, fields)?;
    let cdr_type = structure.cdr_type_impl(input, &attributes.type_name(&input.ident));
    let dds_type = crate::dds_type_impl(input, attributes, structure.has_key());
    Ok(quote!(#cdr_type #dds_type))
}

struct Structure<'a> {
    extensibility: Extensibility,
    members: Vec<Member<'a>>,
    non_serialized: Vec<&'a Ident>,
}

struct Member<'a> {
    ident: &'a Ident,
    ty: &'a Type,
    name: String,
    id: u32,
    key: bool,
    bound: Option<Expr>,
    uint8: bool,
    default: TokenStream,
}

impl<'a> Structure<'a> {
    fn parse(extensibility: Extensibility, fields: &'a FieldsNamed) -> syn::Result<Self> {
        let mut structure = Self {
            extensibility,
            members: Vec::new(),
            non_serialized: Vec::new(),
        };
        for field in &fields.named {
            let attributes = FieldAttributes::parse(&field.attrs)?;
            let ident = field.ident.as_ref().expect("named fields have names");
            if attributes.non_serialized {
                structure.non_serialized.push(ident);
                continue;
            }
            if attributes.key && is_option(&field.ty) {
                return Err(Error::new_spanned(
                    &field.ty,
                    "a key member is not optional",
                ));
            }
            let next_id = structure.members.last().map_or(0, |member| member.id + 1);
            let id = attributes.id.unwrap_or(next_id);
            if structure.members.iter().any(|member| member.id == id) {
                let message = format!("another member has the id {id}");
                return Err(Error::new_spanned(ident, message));
            }
            structure
                .members
                .push(Member::new(ident, &field.ty, id, attributes));
        }
        Ok(structure)
    }

    fn has_key(&self) -> bool {
        self.members.iter().any(|member| member.key)
    }

    /// What identifies an instance: the keys, or all members when the struct has no keys and is
    /// itself (part of) one.
    fn key_members(&self) -> Vec<&Member<'a>> {
        let has_key = self.has_key();
        let is_part = |member: &&Member<'a>| member.key || !has_key;
        self.members.iter().filter(is_part).collect()
    }

    fn key_members_by_id(&self) -> Vec<&Member<'a>> {
        let mut members = self.key_members();
        members.sort_by_key(|member| member.id);
        members
    }

    fn cdr_type_impl(&self, input: &DeriveInput, type_name: &str) -> TokenStream {
        let cdr = crate::cdr();
        let ident = &input.ident;
        let generics = crate::bound_generics(&input.generics);
        let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
        let extensibility = self.extensibility;
        let types = self.members.iter().map(|member| member.ty);
        let encode = self.encode();
        let decode = match extensibility {
            Extensibility::Final | Extensibility::Appendable => self.decode_in_order(),
            Extensibility::Mutable => self.decode_by_id(),
        };
        let default = self.default_value();
        let describe = description::function(type_name, Some(&self.definition()));
        let key_size = self
            .key_members_by_id()
            .into_iter()
            .map(Member::add_key_size);
        let field_access = fields::of_struct(self.fields());
        quote! {
            #[automatically_derived]
            impl #impl_generics #cdr::CdrType for #ident #type_generics #where_clause {
                const MIN_SIZE: usize = #cdr::min_struct_size(
                    #extensibility,
                    0 #(+ <#types as #cdr::Member>::MIN_SIZE)*
                );

                fn encode(
                    &self,
                    encoder: &mut #cdr::Encoder<'_>,
                ) -> ::core::result::Result<(), #cdr::EncodeError> {
                    encoder.structure(#extensibility, |members| { #encode })
                }

                fn decode(
                    decoder: &mut #cdr::Decoder<'_>,
                ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                    decoder.structure(#extensibility, |members| { #decode })
                }

                fn default_value() -> Self { #default }

                fn add_key_size(size: &mut #cdr::KeySize) { #(#key_size)* }

                #field_access

                #describe
            }
        }
    }

    fn definition(&self) -> TokenStream {
        let cdr = crate::cdr();
        let extensibility = self.extensibility;
        let members = self.members.iter().map(Member::definition);
        quote! {
            #cdr::Definition::Struct {
                extensibility: #extensibility,
                members: ::std::vec![#(#members),*],
            }
        }
    }

    fn fields(&self) -> impl Iterator<Item = StructField<'_>> {
        let has_key = self.has_key();
        self.members.iter().map(move |member| StructField {
            ident: member.ident,
            name: &member.name,
            ty: member.ty,
            is_key: member.key || !has_key,
        })
    }

    fn encode(&self) -> TokenStream {
        let cdr = crate::cdr();
        let all: Vec<_> = self.members.iter().collect();
        let key = self.key_members();
        let hash = self.key_members_by_id();
        let ids = |members: &[&Member<'a>]| members.iter().map(|m| m.id).collect::<Vec<_>>();
        let put = |members: &[&Member<'a>]| -> TokenStream {
            members.iter().map(|member| member.put()).collect()
        };
        let put_all = put(&all);
        if ids(&all) == ids(&hash) {
            return quote!(#put_all Ok(()));
        }
        let (put_key, put_hash) = (put(&key), put(&hash));
        quote! {
            match members.scope() {
                #cdr::Scope::Sample => { #put_all }
                #cdr::Scope::Key => { #put_key }
                #cdr::Scope::KeyHash => { #put_hash }
            }
            Ok(())
        }
    }

    fn decode_in_order(&self) -> TokenStream {
        let cdr = crate::cdr();
        let has_key = self.has_key();
        let takes = self.members.iter().enumerate().map(|(index, member)| {
            let Member { ty, default, .. } = member;
            let variable = format_ident!("member_{index}");
            let info = member.info();
            let take = quote!(members.take::<#ty>(&#info, || #default)?);
            let check = member.check(&quote!(&#variable));
            if has_key && !member.key {
                quote! {
                    let #variable: #ty = if whole { #take } else { #default };
                    #check
                }
            } else {
                quote!(let #variable: #ty = #take; #check)
            }
        });
        let whole = has_key.then(|| quote!(let whole = members.scope() == #cdr::Scope::Sample;));
        let construct = self.construct();
        quote!(#whole #(#takes)* #construct)
    }

    fn decode_by_id(&self) -> TokenStream {
        let variables = self.variables();
        let types = self.members.iter().map(|member| member.ty);
        let ids = self.members.iter().map(|member| member.id);
        let finishes = self
            .members
            .iter()
            .zip(self.variables())
            .map(|(member, variable)| {
                let Member { default, .. } = member;
                let info = member.info();
                let check = member.check(&quote!(&#variable));
                quote! {
                    let #variable = members.finish(&#info, #variable, || #default)?;
                    #check
                }
            });
        let construct = self.construct();
        let assigned = self.variables();
        quote! {
            #(let mut #variables: ::core::option::Option<#types> = ::core::option::Option::None;)*
            while let ::core::option::Option::Some(header) = members.next()? {
                match header.id() {
                    #(#ids => #assigned = members.value(&header)?,)*
                    _ => members.skip(&header)?,
                }
            }
            #(#finishes)*
            #construct
        }
    }

    fn variables(&self) -> Vec<Ident> {
        (0..self.members.len())
            .map(|index| format_ident!("member_{index}"))
            .collect()
    }

    fn construct(&self) -> TokenStream {
        let idents = self.members.iter().map(|member| member.ident);
        let variables = self.variables();
        let non_serialized = &self.non_serialized;
        quote! {
            Ok(Self {
                #(#idents: #variables,)*
                #(#non_serialized: ::core::default::Default::default(),)*
            })
        }
    }

    fn default_value(&self) -> TokenStream {
        let idents = self.members.iter().map(|member| member.ident);
        let defaults = self.members.iter().map(|member| &member.default);
        let non_serialized = &self.non_serialized;
        quote! {
            Self {
                #(#idents: #defaults,)*
                #(#non_serialized: ::core::default::Default::default(),)*
            }
        }
    }
}

impl<'a> Member<'a> {
    fn new(ident: &'a Ident, ty: &'a Type, id: u32, attributes: FieldAttributes) -> Self {
        let cdr = crate::cdr();
        let default = match attributes.default {
            Some(expression) => quote!((#expression)),
            None => quote!(<#ty as #cdr::Member>::default_member()),
        };
        Self {
            ident,
            ty,
            name: idl_name(attributes.name.as_ref(), ident),
            id,
            key: attributes.key,
            bound: attributes.bound,
            uint8: attributes.uint8,
            default,
        }
    }

    fn info(&self) -> TokenStream {
        let cdr = crate::cdr();
        let (name, id, key) = (&self.name, self.id, self.key);
        quote!(#cdr::MemberInfo { name: #name, id: #id, must_understand: #key })
    }

    fn definition(&self) -> TokenStream {
        let cdr = crate::cdr();
        let Self {
            ty, name, id, key, ..
        } = self;
        let member_type = description::member_type(ty, self.bound.as_ref(), self.uint8);
        quote! {
            #cdr::StructMember {
                name: #name,
                id: #id,
                key: #key,
                optional: <#ty as #cdr::Member>::IS_OPTIONAL,
                member_type: #member_type,
            }
        }
    }

    fn put(&self) -> TokenStream {
        let ident = self.ident;
        let info = self.info();
        let check = self.check(&quote!(&self.#ident));
        quote!(#check members.put(&#info, &self.#ident)?;)
    }

    fn check(&self, value: &TokenStream) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let name = &self.name;
        let bound = self.bound.as_ref()?;
        Some(quote!(#cdr::check_bound(#name, #bound, #value)?;))
    }

    fn add_key_size(&self) -> TokenStream {
        let cdr = crate::cdr();
        let ty = self.ty;
        match &self.bound {
            Some(bound) => quote! {
                size.add_unless_exceeded(|size| {
                    <#ty as #cdr::Bounded>::add_bounded_key_size(size, #bound);
                });
            },
            None => quote!(size.add_unless_exceeded(<#ty as #cdr::Member>::add_key_size);),
        }
    }
}

fn is_option(ty: &Type) -> bool {
    match ty {
        Type::Path(path) => path
            .path
            .segments
            .last()
            .is_some_and(|segment| segment.ident == "Option"),
        _ => false,
    }
}
