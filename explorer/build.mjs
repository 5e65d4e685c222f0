// Builds the page, one file: node build.mjs [PAGE]. Python's settings come from .venv, or from PYTHON.
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {build} from 'esbuild';

const here = import.meta.dirname, root = join(here, '..'), kernel = join(root, 'ca_ros', 'kernel');
const page = process.argv[2] ?? join(root, 'ca_ros', 'explorer.html');
const folder = mkdtempSync(join(tmpdir(), 'explorer-')), wasm = join(folder, 'kernel.wasm');
const python = process.env.PYTHON ?? join(root, '.venv', 'bin', 'python');
const read = (...names) => readFileSync(join(...names), 'utf8');
const {sources} = JSON.parse(read(kernel, 'files.json')).exact;
const parts = sources.filter((name) => name !== 'exact.c') // binding.c includes it
  .map((name) => join(kernel, name));
try {
  execFileSync('clang', ['--target=wasm32', '-std=c99', '-O2', '-ffreestanding', '-nostdlib',
    '-ffp-contract=off', '-mbulk-memory', '-fvisibility=hidden', '-Wall', '-Wextra', '-Werror',
    `-I${here}/freestanding`, `-I${kernel}`,
    join(here, 'flight.c'), ...parts, '-Wl,--no-entry,--export-dynamic,-z,stack-size=262144', '-o', wasm],
  {stdio: 'inherit'});
  const names = readdirSync(join(root, 'config')).filter((name) => name.endsWith('.yaml'));
  const vehicles = Object.fromEntries(names.map((name) => [name.slice(0, -5), read(root, 'config', name)]));
  const SETTINGS = execFileSync(python, [join(here, 'settings.py')], {encoding: 'utf8'});
  const {outputFiles: [{text: script}]} = await build({
    entryPoints: [join(here, 'src', 'main.js')], bundle: true, minify: true, write: false, format: 'esm',
    target: 'es2022', loader: {'.wasm': 'binary'}, alias: {'kernel.wasm': wasm}, legalComments: 'inline',
    define: {VEHICLES: JSON.stringify(vehicles), SETTINGS},
  });
  const inserted = {STYLE: read(here, 'src', 'style.css'),
    SCRIPT: script.replaceAll('</script', '<\\/script')};
  const text = read(here, 'src', 'index.html')
    .replace(/\/\* (STYLE|SCRIPT) \*\//g, (_, name) => inserted[name]);
  writeFileSync(page, text);
  console.log(`Written: ${page} (${(text.length / 1e6).toFixed(2)} MB)`);
} finally {
  rmSync(folder, {recursive: true});
}
