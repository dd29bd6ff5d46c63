#!/usr/bin/env python3
"""Compares the public API of the crate foveate with the stored list, crates/foveate/api.txt: every name that its users reach, with its
types. cargo semver-checks does not follow the names of the facade into the other crates.

Usage: .ci/api.py [--write]

--write stores the list. What is hidden from the documentation is left out, since it has no promise of stability. The features are those
of a build of the whole workspace. rustdoc's JSON is unstable: with another format than that of the stored list nothing is compared, and
a later Rust may need changes here.
"""
import difflib
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STORED = ROOT / "crates/foveate/api.txt"


def documented():
    """rustdoc's JSON of the libraries of the workspace, by name."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    with tempfile.TemporaryDirectory() as folder:
        # Only rustdoc gets the unstable option: dependencies are those of other builds.
        rustdoc = Path(folder, "rustdoc")
        rustdoc.write_text('#!/bin/sh\nRUSTC_BOOTSTRAP=1 exec rustdoc "$@"\n')
        rustdoc.chmod(0o755)
        environment = {**os.environ, "RUSTDOC": str(rustdoc), "RUSTDOCFLAGS": "-Z unstable-options --output-format json"}
        subprocess.run(["cargo", "doc", "--quiet", "--workspace", "--no-deps", "--locked"], cwd=ROOT, env=environment, check=True)
    return [json.loads(path.read_text()) for path in sorted(target.glob("doc/foveate*.json"))]


def kind_of(item):
    (kind, inner), = item["inner"].items()
    return kind, inner


class Api:
    def __init__(self, crates):
        # Where an item is defined: its path in its own crate.
        self.defined = {}
        for crate in crates:
            for key, path in crate["paths"].items():
                if path["crate_id"] == 0 and key in crate["index"]:
                    self.defined["::".join(path["path"])] = (crate, key)
        self.root = next(crate for crate in crates if crate["index"][str(crate["root"])]["name"] == "foveate")
        self.seen, self.lines = {}, []

    def listed(self):
        self.module(self.root, str(self.root["root"]), "")
        return self.lines

    # Types, as in code, without the paths of their names.

    def types(self, types):
        return ", ".join(map(self.type, types))

    def arguments(self, path):
        given = path.get("args") or {}
        if "parenthesized" in given:
            given = given["parenthesized"]
            return f"({self.types(given['inputs'])}){self.result(given['output'])}"
        given = given.get("angle_bracketed", {"args": [], "constraints": []})
        words = []
        for argument in given["args"]:
            (kind, value), = argument.items() if isinstance(argument, dict) else [(argument, None)]
            words.append({"type": self.type, "lifetime": str, "const": lambda it: it["expr"]}.get(kind, lambda _: "_")(value))
        for constraint in given["constraints"]:
            bound = constraint["binding"]
            value = bound.get("equality")
            words.append(f"{constraint['name']} = {self.type(value['type'])}" if value else f"{constraint['name']}: {self.bounds(bound['constraint'])}")
        return f"<{', '.join(words)}>" if words else ""

    def path(self, path):
        return path["path"].rsplit("::", 1)[-1] + self.arguments(path)

    def bounds(self, bounds):
        words = []
        for bound in bounds:
            if "trait_bound" in bound:
                sign = {"maybe": "?", "none": ""}.get(bound["trait_bound"]["modifier"], "")
                words.append(sign + self.path(bound["trait_bound"]["trait"]))
            elif "outlives" in bound:
                words.append(bound["outlives"])
        return " + ".join(words)

    def result(self, output):
        return f" -> {self.type(output)}" if output else ""

    def type(self, it):
        if it is None or it == "infer":
            return "_"
        (kind, inner), = it.items()
        match kind:
            case "resolved_path":
                return self.path(inner)
            case "generic" | "primitive":
                return inner
            case "borrowed_ref":
                lifetime = f"{inner['lifetime']} " if inner["lifetime"] else ""
                return f"&{lifetime}{'mut ' if inner['is_mutable'] else ''}{self.type(inner['type'])}"
            case "raw_pointer":
                return f"*{'mut' if inner['is_mutable'] else 'const'} {self.type(inner['type'])}"
            case "slice":
                return f"[{self.type(inner)}]"
            case "array":
                return f"[{self.type(inner['type'])}; {inner['len']}]"
            case "tuple":
                return f"({self.types(inner)})"
            case "impl_trait":
                return f"impl {self.bounds(inner)}"
            case "dyn_trait":
                return " + ".join(["dyn " + " + ".join(self.path(it["trait"]) for it in inner["traits"])] + [inner["lifetime"]] * bool(inner["lifetime"]))
            case "function_pointer":
                return f"fn({self.types(it for _, it in inner['sig']['inputs'])}){self.result(inner['sig']['output'])}"
            case "qualified_path":
                return f"{self.type(inner['self_type'])}::{inner['name']}"
        sys.exit(f".ci/api.py: a type of an unknown kind, {kind}: rustdoc's JSON has changed")

    def generics(self, generics):
        words = []
        for parameter in generics["params"]:
            (kind, inner), = parameter["kind"].items()
            if kind == "type" and not inner["is_synthetic"]:
                bounds = self.bounds(inner["bounds"])
                words.append(parameter["name"] + (f": {bounds}" if bounds else ""))
            elif kind == "const":
                words.append(f"const {parameter['name']}: {self.type(inner['type'])}")
            elif kind == "lifetime":
                words.append(parameter["name"])
        where = []
        for predicate in generics["where_predicates"]:
            if "bound_predicate" in predicate:
                where.append(f"{self.type(predicate['bound_predicate']['type'])}: {self.bounds(predicate['bound_predicate']['bounds'])}")
        return f"<{', '.join(words)}>" if words else "", f" where {', '.join(where)}" if where else ""

    def function(self, name, it):
        parameters, where = self.generics(it["generics"])
        header = it["header"]
        words = "".join(f"{word} " for word in ("const", "unsafe") if header[f"is_{word}"])
        # `self` and its references as they are written.
        own = {"Self": "self", "&Self": "&self", "&mut Self": "&mut self"}
        inputs = [(key, self.type(value)) for key, value in it["sig"]["inputs"]]
        inputs = [own.get(value, f"self: {value}") if key == "self" else f"{key}: {value}" for key, value in inputs]
        return f"{words}fn {name}{parameters}({', '.join(inputs)}){self.result(it['sig']['output'])}{where}"

    # Items: a line each, members below their type.

    def module(self, crate, key, name):
        module = crate["index"][key]["inner"]["module"]
        for child in sorted(module["items"], key=lambda child: self.label(crate["index"][str(child)])):
            self.item(crate, str(child), name)

    def label(self, item):
        kind, inner = kind_of(item)
        return inner["name"] if kind == "use" else item["name"] or ""

    def item(self, crate, key, parent):
        item = crate["index"][key]
        kind, inner = kind_of(item)
        name = f"{parent}::{self.label(item)}".removeprefix("::")
        if kind == "use":
            target = str(inner["id"])
            path = "::".join(crate["paths"][target]["path"]) if target in crate["paths"] else inner["source"]
            if target not in crate["index"]:
                if path not in self.defined:
                    # Of no crate of this project.
                    self.lines.append(f"{name} = {path}")
                    return
                crate, target = self.defined[path]
            return self.named(crate, target, name)
        self.named(crate, key, name)

    def named(self, crate, key, name):
        item = crate["index"][key]
        kind, it = kind_of(item)
        if kind == "use":
            return self.item(crate, key, name.rpartition("::")[0])
        known = (crate["index"][str(crate["root"])]["name"], key)
        if known in self.seen:
            self.lines.append(f"{name} = {self.seen[known]}")
            return
        self.seen[known] = name
        add = self.lines.append
        if kind == "module":
            add(f"mod {name}")
            return self.module(crate, key, name)
        if kind == "function":
            return add(self.function(name, it))
        if kind == "constant":
            return add(f"const {name}: {self.type(it['type'])}")
        if kind == "macro":
            return add(f"macro {name}")
        parameters, where = self.generics(it["generics"])
        if kind == "type_alias":
            return add(f"type {name}{parameters} = {self.type(it['type'])}")
        if kind not in ("struct", "enum", "trait"):
            sys.exit(f".ci/api.py: {name} is of an unknown kind, {kind}")
        exhaustive = "" if not any("non_exhaustive" in str(word) for word in item["attrs"]) else "non_exhaustive "
        bounds = self.bounds(it["bounds"]) if kind == "trait" else ""
        add(f"{exhaustive}{kind} {name}{parameters}{': ' + bounds if bounds else ''}{where}")
        if kind == "struct":
            self.fields(crate, it["kind"])
        elif kind == "enum":
            for variant in it["variants"]:
                variant = crate["index"][str(variant)]
                add(f"  {variant['name']}")
                self.fields(crate, variant["inner"]["variant"]["kind"], "    ")
        else:
            for member in it["items"]:
                self.member(crate, member, required=True)
        traits, members = [], []
        for block in it["impls"] if kind != "trait" else []:
            block = crate["index"][str(block)]["inner"]["impl"]
            if block["is_synthetic"] or block["blanket_impl"]:
                continue
            if block["trait"]:
                traits.append(("!" if block["is_negative"] else "") + self.path(block["trait"]))
                continue
            members += block["items"]
        for member in sorted(members, key=lambda member: crate["index"][str(member)]["name"] if str(member) in crate["index"] else ""):
            self.member(crate, member)
        # Those that a macro adds beside `PartialEq` say nothing to users.
        traits = sorted(set(traits) - {"StructuralPartialEq"})
        if traits:
            add(f"  impl {', '.join(traits)}")

    def fields(self, crate, kind, indent="  "):
        if kind in ("unit", "plain"):
            return
        (shape, inner), = kind.items()
        fields = inner if isinstance(inner, list) else inner["fields"]
        for at, field in enumerate(fields):
            if field is not None and str(field) in crate["index"]:
                field = crate["index"][str(field)]
                self.lines.append(f"{indent}{field['name'] or at}: {self.type(field['inner']['struct_field'])}")
        if isinstance(inner, dict) and inner["has_stripped_fields"] or isinstance(inner, list) and None in inner:
            self.lines.append(f"{indent}..")

    def member(self, crate, key, required=False):
        member = crate["index"].get(str(key))
        if member is None:
            return
        kind, it = kind_of(member)
        name = member["name"]
        if kind == "function":
            text = self.function(name, it) + (" {..}" if required and it["has_body"] else "")
        elif kind == "assoc_const":
            text = f"const {name}: {self.type(it['type'])}"
        elif kind == "assoc_type":
            text = f"type {name}"
        else:
            sys.exit(f".ci/api.py: {name} is of an unknown kind, {kind}")
        self.lines.append(f"  {text}")


def main():
    crates = documented()
    form = f"rustdoc's JSON, format {crates[0]['format_version']}"
    if sys.argv[1:] != ["--write"] and (found := STORED.read_text().partition("\n")[0]) != form:
        print(f"skipped: the stored list is of {found}, this Rust has {form}")
        return
    lines = [form, *Api(crates).listed()]
    text = "".join(f"{line}\n" for line in lines)
    if sys.argv[1:] == ["--write"]:
        STORED.write_text(text)
        return
    stored = STORED.read_text()
    if text != stored:
        differences = difflib.unified_diff(stored.splitlines(), text.splitlines(), "crates/foveate/api.txt", "the code", lineterm="", n=1)
        sys.exit("\n".join([*differences, "the public API has changed. If that is wanted: .ci/api.py --write, and a line in CHANGELOG.md"]))
    print(f"{len(lines)} lines, as stored")


main()
