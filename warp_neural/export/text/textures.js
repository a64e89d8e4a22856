// The numbers that a shader reads: latent textures in BC1 blocks, decoded where the driver has no such format, and a
// table of floats.

function bytesOf(text) {
    return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}

function expanded(code) {
    const red = code >> 11, green = (code >> 5) & 63, blue = code & 31;
    return [(red << 3) | (red >> 2), (green << 2) | (green >> 4), (blue << 3) | (blue >> 2)];
}

function decodedBlocks(bytes, width, height) {
    const blocks = new DataView(bytes.buffer), result = new Uint8Array(4 * width * height).fill(255);
    const columns = Math.ceil(width / 4);
    const mixed = (a, b, i, j) => a.map((_, c) => Math.floor((i * a[c] + j * b[c]) / (i + j)));
    for (let y = 0; y < height; ++y) {
        for (let x = 0; x < width; ++x) {
            const at = 8 * ((y >> 2) * columns + (x >> 2)), texel = 4 * (y & 3) + (x & 3);
            const [first, second] = [blocks.getUint16(at, true), blocks.getUint16(at + 2, true)];
            const index = (blocks.getUint32(at + 4, true) >>> (2 * texel)) & 3;
            const a = expanded(first), b = expanded(second);
            let colour = index === 0 ? a : b;
            if (index > 1 && first > second) colour = index === 2 ? mixed(a, b, 2, 1) : mixed(a, b, 1, 2);
            else if (index > 1) colour = index === 2 ? mixed(a, b, 1, 1) : [0, 0, 0];
            result.set(colour, 4 * (y * width + x));
        }
    }
    return result;
}

function uploadBlocks(gl, latent) {
    const format = gl.getExtension("WEBGL_compressed_texture_s3tc")?.COMPRESSED_RGB_S3TC_DXT1_EXT;
    const sizes = latent.levels.map((_, k) => [Math.max(latent.width >> k, 1), Math.max(latent.height >> k, 1)]);
    const target = gl.TEXTURE_2D, count = sizes.length;
    gl.texStorage2D(target, count, format ?? gl.RGBA8, ...sizes[0]);
    sizes.forEach((size, k) => {
        const blocks = bytesOf(latent.levels[k]), place = [target, k, 0, 0, ...size];
        if (format) gl.compressedTexSubImage2D(...place, format, blocks);
        else gl.texSubImage2D(...place, gl.RGBA, gl.UNSIGNED_BYTE, decodedBlocks(blocks, ...size));
    });
    const filter = count > 1 ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR;
    gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);  // it repeats by default, and magnifies linearly
}

function uploadTable(gl, table) {
    const values = new Float32Array(bytesOf(table.values).buffer), target = gl.TEXTURE_2D;
    gl.texStorage2D(target, 1, gl.R32F, table.width, values.length / table.width);
    gl.texSubImage2D(target, 0, 0, 0, table.width, values.length / table.width, gl.RED, gl.FLOAT, values);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(target, name, gl.NEAREST);
}

function loadTextures(gl, program, data) {
    const uploads = data.latents.map((latent, g) => [`latent_${g}`, () => uploadBlocks(gl, latent)]);
    if (data.table) uploads.push(["weights", () => uploadTable(gl, data.table)]);
    uploads.forEach(([name, upload], unit) => {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
        upload();
        gl.uniform1i(gl.getUniformLocation(program, name), unit);
    });
    return gl.getError() === gl.NO_ERROR;
}
