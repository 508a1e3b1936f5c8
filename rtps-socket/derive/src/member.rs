//! A struct's member: what it is, and the calls that write and read it.

use proc_macro2::TokenStream;
use quote::{format_ident, quote};
use syn::{Error, Expr, Field, Ident, Type};

use crate::attributes::{FieldAttributes, TryConstruct, hashed_id, idl_name};
use crate::description;

pub(crate) struct Member<'a> {
    pub(crate) ident: &'a Ident,
    pub(crate) ty: &'a Type,
    pub(crate) name: String,
    pub(crate) id: Id,
    pub(crate) key: bool,
    pub(crate) default: TokenStream,
    /// Where it was read into.
    variable: Ident,
    bound: Option<Expr>,
    uint8: bool,
    must_understand: bool,
    external: bool,
    try_construct: TryConstruct,
    hash_id: Option<String>,
}

/// A member's id.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Id {
    Number(u32),
    /// So many after the last id that is inherited.
    AfterInherited(u32),
}

impl Id {
    pub(crate) fn next(self) -> Self {
        match self {
            Self::Number(number) => Self::Number(number + 1),
            Self::AfterInherited(number) => Self::AfterInherited(number + 1),
        }
    }

    /// The number, where `base` is inherited from.
    pub(crate) fn number(self, base: Option<&Type>) -> TokenStream {
        let cdr = crate::cdr();
        match self {
            Self::Number(number) => quote!(#number),
            Self::AfterInherited(number) => {
                quote!((<#base as #cdr::Struct>::MEMBER_IDS.next() + #number))
            }
        }
    }
}

impl<'a> Member<'a> {
    /// A member with the id that its attributes say, else `next_id`, or a hash.
    pub(crate) fn new(
        field: &'a Field,
        attributes: FieldAttributes,
        next_id: Id,
        autoid_hash: bool,
    ) -> syn::Result<Self> {
        let cdr = crate::cdr();
        let ident = field.ident.as_ref().expect("named fields have names");
        let ty = &field.ty;
        if attributes.key && is_option(ty) {
            return Err(Error::new_spanned(ty, "a key member is not optional"));
        }
        if attributes.try_construct == TryConstruct::Trim && attributes.bound.is_none() {
            return Err(Error::new_spanned(ident, "to what is it trimmed: `bound`?"));
        }
        let name = idl_name(attributes.name.as_ref(), ident);
        let id = match (attributes.id, &attributes.hash_id) {
            (Some(number), _) => Id::Number(number),
            (None, Some(hashed)) if !hashed.is_empty() => Id::Number(hashed_id(hashed)),
            (None, Some(_)) => Id::Number(hashed_id(&name)),
            (None, None) if autoid_hash => Id::Number(hashed_id(&name)),
            (None, None) => next_id,
        };
        Ok(Self {
            ident,
            ty,
            name,
            id,
            key: attributes.key,
            default: match attributes.default {
                Some(expression) => quote!((#expression)),
                None => quote!(<#ty as #cdr::Member>::default_member()),
            },
            variable: format_ident!("member_{}", ident),
            bound: attributes.bound,
            uint8: attributes.uint8,
            must_understand: attributes.key || attributes.must_understand,
            external: attributes.external,
            try_construct: attributes.try_construct,
            hash_id: attributes.hash_id,
        })
    }

    pub(crate) fn variable(&self) -> &Ident {
        &self.variable
    }

    fn info(&self, base: Option<&Type>) -> TokenStream {
        let cdr = crate::cdr();
        let Self {
            name,
            key,
            must_understand,
            ..
        } = self;
        let id = self.id.number(base);
        quote! {
            #cdr::MemberInfo { name: #name, id: #id, must_understand: #must_understand, key: #key }
        }
    }

    pub(crate) fn definition(&self, base: Option<&Type>) -> TokenStream {
        let cdr = crate::cdr();
        let Self {
            ty,
            name,
            key,
            must_understand,
            external,
            try_construct,
            ..
        } = self;
        let id = self.id.number(base);
        let member_type = description::member_type(ty, self.bound.as_ref(), self.uint8);
        let hash_id = match &self.hash_id {
            Some(name) => quote!(::core::option::Option::Some(#name)),
            None => quote!(::core::option::Option::None),
        };
        quote! {
            #cdr::StructMember {
                name: #name,
                id: #id,
                key: #key,
                must_understand: #must_understand,
                optional: <#ty as #cdr::Member>::IS_OPTIONAL,
                external: #external,
                try_construct: #try_construct,
                hash_id: #hash_id,
                member_type: #member_type,
            }
        }
    }

    pub(crate) fn put(&self, base: Option<&Type>) -> TokenStream {
        let ident = self.ident;
        let info = self.info(base);
        let check = self.check(&quote!(&self.#ident));
        quote!(#check members.put(&#info, &self.#ident)?;)
    }

    /// Reads it as the next member.
    pub(crate) fn take(&self, base: Option<&Type>) -> TokenStream {
        let Self { ty, default, .. } = self;
        let info = self.info(base);
        match self.try_construct {
            TryConstruct::UseDefault => {
                quote!(members.take_or_default::<#ty>(&#info, || #default)?)
            }
            TryConstruct::Discard | TryConstruct::Trim => {
                quote!(members.take::<#ty>(&#info, || #default)?)
            }
        }
    }

    /// Reads the value behind `header`.
    pub(crate) fn value(&self) -> TokenStream {
        let default = &self.default;
        match self.try_construct {
            TryConstruct::UseDefault => quote!(members.value_or_default(&header, || #default)?),
            TryConstruct::Discard | TryConstruct::Trim => quote!(members.value(&header)?),
        }
    }

    /// The value that was read, or the default.
    pub(crate) fn finish(&self, base: Option<&Type>) -> TokenStream {
        let Self {
            variable, default, ..
        } = self;
        let info = self.info(base);
        let construct = self.construct();
        quote! {
            let #variable = members.finish(&#info, #variable, || #default)?;
            #construct
        }
    }

    /// Makes what was read a value that the bound allows.
    pub(crate) fn construct(&self) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let Self {
            variable, default, ..
        } = self;
        let bound = self.bound.as_ref()?;
        match self.try_construct {
            TryConstruct::Discard => self.check(&quote!(&#variable)),
            TryConstruct::UseDefault => Some(quote! {
                let #variable = if #cdr::is_beyond(#bound, &#variable) { #default } else { #variable };
            }),
            TryConstruct::Trim => Some(quote!(let #variable = #cdr::trim(#bound, #variable);)),
        }
    }

    fn check(&self, value: &TokenStream) -> Option<TokenStream> {
        let cdr = crate::cdr();
        let name = &self.name;
        let bound = self.bound.as_ref()?;
        Some(quote!(#cdr::check_bound(#name, #bound, #value)?;))
    }

    pub(crate) fn add_key_size(&self) -> TokenStream {
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
