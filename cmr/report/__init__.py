"""Reports as single pages of HTML: the skeleton, the style, text, tables, and plots as SVG. It knows no robot.

`page` puts a report together from `section`s. `svg` draws plots, `density` swarms, `keys` what their lines stand for;
`readings.js` shows the values of their curves. `style` has the colours, light and dark. `markup` escapes.
"""
