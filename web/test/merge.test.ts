import { expect, test } from "vitest";
import { EMPTY, merged, sameNote } from "../src/explorer/merge";

const note = (text: string, ...labels: string[]) => ({ note: text, labels });

test("what only one of two pages changed is kept", () => {
  expect(merged(note("a"), note("b"), note("a"))).toEqual(note("b"));
  expect(merged(note("a"), note("a", "x"), note("c"))).toEqual(note("c", "x"));
  expect(merged(EMPTY, note("", "x"), note("long note"))).toEqual(note("long note", "x"));
});

test("what both changed is kept from both", () => {
  expect(merged(note("a"), note("mine"), note("theirs"))).toEqual(note("theirs\n\nmine"));
  expect(merged(note("", "a", "b"), note("", "b", "c"), note("", "a", "b", "d"))).toEqual(note("", "b", "d", "c"));
});

test("what one page removed stays removed, unless the other wrote anew", () => {
  expect(merged(note("a", "x"), EMPTY, note("a", "x"))).toEqual(EMPTY);
  expect(merged(note("a"), EMPTY, note("b"))).toEqual(note("b"));
});

test("notes are the same by what they say", () => {
  expect(sameNote(note("a", "x"), note("a", "x"))).toBe(true);
  expect(sameNote(note("a", "x"), note("a"))).toBe(false);
});
