// Builds the page, one file with all that it needs: node build.mjs [PAGE]. Python's settings come from .venv, or from PYTHON.
import {execFileSync} from 'node:child_process';
import {mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync} from 'node:fs';
import {tmpdir} from 'node:os';
import {join} from 'node:path';
import {build} from 'esbuild';

const here = import.meta.dirname, root = join(here, '..'), kernel = join(root, 'ca_ros', 'kernel');
const page = process.argv[2] ?? join(root, 'ca_ros', 'explorer.html'), folder = mkdtempSync(join(tmpdir(), 'explorer-'));
const parts = readdirSync(kernel).filter((name) => /\.c$/.test(name) && !/^exact|^detector|^vectored|module/.test(name));
const python = process.env.PYTHON ?? join(root, '.venv', 'bin', 'python');
try {
  execFileSync('clang', ['--target=wasm32', '-std=c99', '-O2', '-ffreestanding', '-nostdlib', '-ffp-contract=off',
    '-mbulk-memory', '-fvisibility=hidden', '-Wall', '-Wextra', '-Werror', `-I${here}/freestanding`, `-I${kernel}`,
    join(here, 'binding.c'), ...parts.map((name) => join(kernel, name)), '-Wl,--no-entry,--export-dynamic,-z,stack-size=262144',
    '-o', join(folder, 'kernel.wasm')], {stdio: 'inherit'});
  const vehicles = Object.fromEntries(readdirSync(join(root, 'config')).filter((name) => name.endsWith('.yaml'))
    .map((name) => [name.slice(0, -5), readFileSync(join(root, 'config', name), 'utf8')]));
  const {outputFiles: [{text: script}]} = await build({
    entryPoints: [join(here, 'src', 'main.js')], bundle: true, minify: true, write: false, format: 'esm', target: 'es2022',
    loader: {'.wasm': 'binary'}, alias: {'kernel.wasm': join(folder, 'kernel.wasm')}, legalComments: 'inline',
    define: {VEHICLES: JSON.stringify(vehicles), SETTINGS: execFileSync(python, ['-m', 'ca_ros.explore'], {cwd: root, encoding: 'utf8'})},
  });
  const [html, css] = ['index.html', 'style.css'].map((name) => readFileSync(join(here, 'src', name), 'utf8'));
  const parts_of_page = {STYLE: css, SCRIPT: script.replaceAll('</script', '<\\/script')};
  const text = html.replace(/\/\* (STYLE|SCRIPT) \*\//g, (_, name) => parts_of_page[name]);
  writeFileSync(page, text);
  console.log(`Written: ${page} (${(text.length / 1e6).toFixed(2)} MB)`);
} finally {
  rmSync(folder, {recursive: true});
}
