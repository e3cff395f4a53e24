// The types of the vendored modules, for the check of the page's own code alone.
export * from "three";
