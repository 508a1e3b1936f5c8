//! Structs: their members in definition order, those that are inherited first, and the key members alone.

use proc_macro2::TokenStream;
use quote::quote;
use syn::{DeriveInput, Error, FieldsNamed, Ident, Type};

use crate::attributes::{Extensibility, FieldAttributes, TypeAttributes};
use crate::description;
use crate::fields::{self, StructField};
use crate::member::{Id, Member};

pub(crate) fn expand(
    input: &DeriveInput,
    attributes: &TypeAttributes,
    fields: &FieldsNamed,
) -> syn::Result<TokenStream> {
    if let Some(literal) = &attributes.bit_bound {
        return Err(Error::new_spanned(
            literal,
            "`bit_bound` is for enumerations and bitmasks",
        ));
    }
    if let Some(ident) = &attributes.discriminator {
        return Err(Error::new_spanned(ident, "`discriminator` is for unions"));
    }
    let structure = Structure::parse(attributes, fields)?;
    let cdr_type = structure.cdr_type_impl(input, &attributes.type_name(&input.ident));
    let struct_impl = structure.struct_impl(input);
    let dds_type = crate::dds_type_impl(input, attributes, &structure.has_key());
    Ok(quote!(#cdr_type #struct_impl #dds_type))
}

struct Structure<'a> {
    extensibility: Extensibility,
    autoid_hash: bool,
    base: Option<(&'a Ident, &'a Type)>,
    members: Vec<Member<'a>>,
    non_serialized: Vec<&'a Ident>,
}

impl<'a> Structure<'a> {
    fn parse(attributes: &TypeAttributes, fields: &'a FieldsNamed) -> syn::Result<Self> {
        let mut structure = Self {
            extensibility: attributes.extensibility,
            autoid_hash: attributes.autoid_hash,
            base: None,
            members: Vec::new(),
            non_serialized: Vec::new(),
        };
        for field in &fields.named {
            let attributes = FieldAttributes::parse(&field.attrs)?;
            let ident = field.ident.as_ref().expect("named fields have names");
            if attributes.non_serialized {
                structure.non_serialized.push(ident);
            } else if attributes.base {
                if structure.base.is_some() || !structure.members.is_empty() {
                    return Err(Error::new_spanned(
                        ident,
                        "a struct inherits from one other, whose members come first",
                    ));
                }
                structure.base = Some((ident, &field.ty));
            } else {
                let next_id = structure.next_id();
                let member = Member::new(field, attributes, next_id, structure.autoid_hash)?;
                structure.add(member)?;
            }
        }
        Ok(structure)
    }

    fn next_id(&self) -> Id {
        match (self.members.last(), self.base) {
            (Some(member), _) => member.id.next(),
            (None, Some(_)) => Id::AfterInherited(0),
            (None, None) => Id::Number(0),
        }
    }

    fn add(&mut self, member: Member<'a>) -> syn::Result<()> {
        if let Some(other) = self.members.iter().find(|other| other.id == member.id) {
            let message = format!("the member `{}` has the same id", other.name);
            return Err(Error::new_spanned(member.ident, message));
        }
        self.members.push(member);
        Ok(())
    }

    fn base_type(&self) -> Option<&'a Type> {
        self.base.map(|(_, ty)| ty)
    }

    fn has_own_key(&self) -> bool {
        self.members.iter().any(|member| member.key)
    }

    /// `HAS_KEY` of what is inherited from.
    fn base_has_key(&self) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let base = self.base_type()?;
        Some(quote!(<#base as #cdr::DdsType>::HAS_KEY))
    }

    fn has_key(&self) -> TokenStream {
        let own = self.has_own_key();
        match self.base_has_key() {
            Some(inherited) => quote!(#own || #inherited),
            None => quote!(#own),
        }
    }

    /// What identifies an instance: the keys, or all members when the struct has no keys and is
    /// itself (part of) one.
    fn key_members(&self) -> Vec<&Member<'a>> {
        let has_key = self.has_own_key();
        let is_part = |member: &&Member<'a>| member.key || !has_key;
        self.members.iter().filter(is_part).collect()
    }

    fn key_members_by_id(&self) -> Vec<&Member<'a>> {
        let mut members = self.key_members();
        members.sort_by_key(|member| member.id);
        members
    }

    /// Whether a key holds the inherited members.
    fn inherits_key(&self) -> Option<TokenStream> {
        let inherited = self.base_has_key()?;
        Some(match self.has_own_key() {
            true => inherited,
            false => quote!(true),
        })
    }

    /// Whether a key holds own members that are not marked so.
    fn holds_unmarked(&self) -> TokenStream {
        match (self.has_own_key(), self.base_has_key()) {
            (true, _) => quote!(false),
            (false, Some(inherited)) => quote!(!#inherited),
            (false, None) => quote!(true),
        }
    }

    fn cdr_type_impl(&self, input: &DeriveInput, type_name: &str) -> TokenStream {
        let cdr = crate::cdr();
        let ident = &input.ident;
        let generics = crate::bound_generics(&input.generics);
        let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
        let extensibility = self.extensibility;
        let types = self.members.iter().map(|member| member.ty);
        let inherited = self.base_type().into_iter();
        let default = self.default_value();
        let describe = description::function(type_name, Some(&self.definition()));
        let key_size = self.add_key_size();
        let field_access = fields::of_struct(self.inherited_fields(), self.fields());
        quote! {
            #[automatically_derived]
            impl #impl_generics #cdr::CdrType for #ident #type_generics #where_clause {
                const MIN_SIZE: usize = #cdr::min_struct_size(
                    #extensibility,
                    0 #(+ <#inherited as #cdr::CdrType>::MIN_SIZE)*
                        #(+ <#types as #cdr::Member>::MIN_SIZE)*
                );

                fn encode(
                    &self,
                    encoder: &mut #cdr::Encoder<'_>,
                ) -> ::core::result::Result<(), #cdr::EncodeError> {
                    encoder.structure(#extensibility, |members| {
                        #cdr::Struct::put_members(self, members)
                    })
                }

                fn decode(
                    decoder: &mut #cdr::Decoder<'_>,
                ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                    decoder.structure(#extensibility, |members| {
                        #cdr::Struct::take_members(members, &<Self as #cdr::Struct>::MEMBER_IDS)
                    })
                }

                fn default_value() -> Self { #default }

                fn add_key_size(size: &mut #cdr::KeySize) { #key_size }

                #field_access

                #describe
            }
        }
    }

    fn struct_impl(&self, input: &DeriveInput) -> TokenStream {
        let cdr = crate::cdr();
        let ident = &input.ident;
        let generics = crate::bound_generics(&input.generics);
        let (impl_generics, type_generics, where_clause) = generics.split_for_impl();
        let base = self.base_type();
        let ids = self.members.iter().map(|member| member.id.number(base));
        let inherited = match base {
            Some(base) => quote!(Some(&<#base as #cdr::Struct>::MEMBER_IDS)),
            None => quote!(None),
        };
        let fits_base = self.check_base();
        let put = self.put();
        let take = match self.extensibility {
            Extensibility::Final | Extensibility::Appendable => self.take_in_order(),
            Extensibility::Mutable => self.take_by_id(),
        };
        quote! {
            #[automatically_derived]
            impl #impl_generics #cdr::Struct for #ident #type_generics #where_clause {
                const MEMBER_IDS: #cdr::MemberIds =
                    #cdr::MemberIds { inherited: #inherited, own: &[#(#ids),*] };

                #[inline]
                fn put_members(
                    &self,
                    members: &mut #cdr::MemberEncoder<'_, '_>,
                ) -> ::core::result::Result<(), #cdr::EncodeError> {
                    #fits_base
                    #put
                }

                #[inline]
                fn take_members(
                    members: &mut #cdr::MemberDecoder<'_, '_>,
                    #[allow(unused_variables, reason = "members in order have no unknown ones")]
                    ids: &#cdr::MemberIds,
                ) -> ::core::result::Result<Self, #cdr::DecodeError> {
                    #take
                }
            }
        }
    }

    /// What can be said of a base only when its type is known.
    fn check_base(&self) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let base = self.base_type()?;
        let extensibility = self.extensibility;
        Some(quote! {
            const {
                assert!(
                    <#base as #cdr::DdsType>::EXTENSIBILITY as u16 == #extensibility as u16,
                    "a struct is as extensible as the one that it inherits from"
                );
                assert!(
                    <Self as #cdr::Struct>::MEMBER_IDS.are_distinct(),
                    "a member has the id of another that is inherited"
                );
            }
        })
    }

    fn definition(&self) -> TokenStream {
        let cdr = crate::cdr();
        let Self {
            extensibility,
            autoid_hash,
            ..
        } = self;
        let base = self.base_type();
        let members = self.members.iter().map(|member| member.definition(base));
        let base = match base {
            Some(base) => {
                quote!(::core::option::Option::Some(<#base as #cdr::CdrType>::describe(types)?))
            }
            None => quote!(::core::option::Option::None),
        };
        quote! {
            #cdr::Definition::Struct {
                extensibility: #extensibility,
                autoid_hash: #autoid_hash,
                base: #base,
                members: ::std::vec![#(#members),*],
            }
        }
    }

    fn fields(&self) -> impl Iterator<Item = StructField<'_>> {
        let unmarked = self.holds_unmarked();
        self.members.iter().map(move |member| StructField {
            ident: member.ident,
            name: &member.name,
            ty: member.ty,
            is_key: match member.key {
                true => quote!(true),
                false => unmarked.clone(),
            },
        })
    }

    fn inherited_fields(&self) -> Option<StructField<'_>> {
        let (ident, ty) = self.base?;
        let is_key = self.inherits_key()?;
        Some(StructField {
            ident,
            name: "",
            ty,
            is_key,
        })
    }

    fn put(&self) -> TokenStream {
        let cdr = crate::cdr();
        let base = self.base_type();
        let all: Vec<_> = self.members.iter().collect();
        let key = self.key_members();
        let hash = self.key_members_by_id();
        let ids = |members: &[&Member<'a>]| members.iter().map(|m| m.id).collect::<Vec<_>>();
        let put = |members: &[&Member<'a>]| -> TokenStream {
            members.iter().map(|member| member.put(base)).collect()
        };
        let put_all = put(&all);
        let put_inherited = self.base.map(|(ident, _)| {
            let put = quote!(#cdr::Struct::put_members(&self.#ident, members)?;);
            let is_key = self.inherits_key();
            quote!(if members.scope() == #cdr::Scope::Sample || #is_key { #put })
        });
        if ids(&all) == ids(&hash) {
            let put_own = match base {
                Some(_) if !self.has_own_key() => {
                    let unmarked = self.holds_unmarked();
                    quote! {
                        if members.scope() == #cdr::Scope::Sample || #unmarked { #put_all }
                    }
                }
                _ => put_all,
            };
            return quote!(#put_inherited #put_own Ok(()));
        }
        let (put_key, put_hash) = (put(&key), put(&hash));
        quote! {
            #put_inherited
            match members.scope() {
                #cdr::Scope::Sample => { #put_all }
                #cdr::Scope::Key => { #put_key }
                #cdr::Scope::KeyHash => { #put_hash }
            }
            Ok(())
        }
    }

    fn take_in_order(&self) -> TokenStream {
        let cdr = crate::cdr();
        let base = self.base_type();
        let is_whole = self.has_own_key() || base.is_some();
        let unmarked = self.holds_unmarked();
        let inherited = self.base.map(|(_, ty)| {
            let is_key = self.inherits_key();
            quote! {
                let inherited: #ty = if whole || #is_key {
                    members.inherited(ids)?
                } else {
                    <#ty as #cdr::CdrType>::default_value()
                };
            }
        });
        let takes = self.members.iter().map(|member| {
            let Member { ty, default, .. } = member;
            let variable = member.variable();
            let take = member.take(base);
            let construct = member.construct();
            if is_whole && !member.key {
                quote! {
                    let #variable: #ty = if whole || #unmarked { #take } else { #default };
                    #construct
                }
            } else {
                quote!(let #variable: #ty = #take; #construct)
            }
        });
        let whole = is_whole.then(|| quote!(let whole = members.scope() == #cdr::Scope::Sample;));
        let build = self.build();
        quote!(#whole #inherited #(#takes)* #build)
    }

    fn take_by_id(&self) -> TokenStream {
        let base = self.base_type();
        let inherited = base.map(|ty| quote!(let inherited: #ty = members.inherited(ids)?;));
        let variables = self.members.iter().map(Member::variable);
        let types = self.members.iter().map(|member| member.ty);
        let arms = self.members.iter().map(|member| {
            let (variable, value) = (member.variable(), member.value());
            let id = member.id.number(base);
            match member.id {
                Id::Number(_) => quote!(#id => #variable = #value,),
                Id::AfterInherited(_) => quote!(id if id == #id => #variable = #value,),
            }
        });
        let finishes = self.members.iter().map(|member| member.finish(base));
        let build = self.build();
        quote! {
            #inherited
            #(let mut #variables: ::core::option::Option<#types> = ::core::option::Option::None;)*
            while let ::core::option::Option::Some(header) = members.next()? {
                match header.id() {
                    #(#arms)*
                    _ => members.skip(&header, ids)?,
                }
            }
            #(#finishes)*
            #build
        }
    }

    fn build(&self) -> TokenStream {
        let inherited = self.base.map(|(ident, _)| quote!(#ident: inherited,));
        let idents = self.members.iter().map(|member| member.ident);
        let variables = self.members.iter().map(Member::variable);
        let non_serialized = &self.non_serialized;
        quote! {
            Ok(Self {
                #inherited
                #(#idents: #variables,)*
                #(#non_serialized: ::core::default::Default::default(),)*
            })
        }
    }

    fn default_value(&self) -> TokenStream {
        let cdr = crate::cdr();
        let inherited = self
            .base
            .map(|(ident, ty)| quote!(#ident: <#ty as #cdr::CdrType>::default_value(),));
        let idents = self.members.iter().map(|member| member.ident);
        let defaults = self.members.iter().map(|member| &member.default);
        let non_serialized = &self.non_serialized;
        quote! {
            Self {
                #inherited
                #(#idents: #defaults,)*
                #(#non_serialized: ::core::default::Default::default(),)*
            }
        }
    }

    fn add_key_size(&self) -> TokenStream {
        let cdr = crate::cdr();
        let inherited = self.base_type().map(|base| {
            let is_key = self.inherits_key();
            quote!(if #is_key { <#base as #cdr::CdrType>::add_key_size(size); })
        });
        let own: TokenStream = self
            .key_members_by_id()
            .into_iter()
            .map(Member::add_key_size)
            .collect();
        let own = match (self.base_type(), self.has_own_key()) {
            (Some(_), false) => {
                let unmarked = self.holds_unmarked();
                quote!(if #unmarked { #own })
            }
            _ => own,
        };
        quote!(#inherited #own)
    }
}
