// Runs Khronos' glTF validator on a file: node tests/gltf_validate.mjs FILE.glb
// Exit code 0: no errors; 1: errors, listed; 77: the package gltf-validator is not installed (NODE_PATH says where).
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const [file] = process.argv.slice(2);
let validator;
try {
  validator = createRequire(import.meta.url)("gltf-validator");
} catch {
  console.log("the package gltf-validator is not installed: npm install gltf-validator, or set NODE_PATH");
  process.exit(77);
}
const report = await validator.validateBytes(new Uint8Array(readFileSync(file)), { maxIssues: 50 });
const { numErrors, numWarnings, numInfos, messages } = report.issues;
console.log(`${file}: ${numErrors} errors, ${numWarnings} warnings, ${numInfos} notes`);
for (const { severity, code, message, pointer } of messages) {
  console.log(`  ${["error", "warning", "note", "hint"][severity]} ${code} ${pointer ?? ""}: ${message}`);
}
process.exit(numErrors > 0 ? 1 : 0);
