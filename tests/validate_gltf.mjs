// Prints the Khronos glTF validator's report on the file named as the first argument, as JSON; of several files, a list.
import { readFileSync } from "node:fs";
import { dirname, join } from "node:path";
import validator from "gltf-validator";

const reports = [];
for (const path of process.argv.slice(2)) {
  reports.push(
    await validator.validateBytes(new Uint8Array(readFileSync(path)), {
      uri: path,
      maxIssues: 0,
      externalResourceFunction: async (uri) =>
        new Uint8Array(readFileSync(join(dirname(path), decodeURIComponent(uri)))),
    }),
  );
}
process.stdout.write(JSON.stringify(reports.length === 1 ? reports[0] : reports, null, 2) + "\n");
