"""Reports as single pages of HTML: the skeleton, the style, text, tables, and plots as SVG. Independent of robots.

`page` puts a report together from `section`s. `svg` draws plots, `density` draws densities of many paths, `keys`
legends; `readings.js` shows values of curves at the pointer. `style` has the colours, light and dark. `markup` escapes.
"""
